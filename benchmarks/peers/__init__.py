"""This project's kernels beside other libraries: ``python -m benchmarks.peers`` writes docs/peers.{json,md,svg}.

cases        the robots, and the chain of 6-DOF joints that grows
contender    one way of computing a kernel's result: an address that the stopwatch calls
ours, pinocchio_peer, mujoco_peer, casadi_peer
             where contenders come from; a peer that cannot be had says why
measure      contenders compared, then timed in turns -> rows
python_calls what calls from Python cost beside the C -> calls
gradients    of rollouts: time and error of several ways -> gradients
required     the ratios to hold
page, plot   rows -> tables and the plot
"""
