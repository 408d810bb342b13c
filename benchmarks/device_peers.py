"""Contenders on a device of CUDA: kernels of eomgen, GRiD, frax under JAX, and MuJoCo Warp, each by its best way.

Each makes of a function's name, a dtype and the arrays of states, (N, n) each, what begins a call, what waits for it,
and what gives its result in NumPy.  States lie on the device before, results stay there.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.description import as_robot
from eomgen.export.mujoco import mjcf
from eomgen.identification.calibration.as_urdf import urdf_of

Array = NDArray[Any]
FUNCTIONS = ("inverse_dynamics", "forward_dynamics", "forward_dynamics_jacobian")
BLOCKS = 2  # of derivatives, by coordinates and velocities, that all have; ours takes those by drives, too
GRAVITY = 9.81  # m/s^2, along -z
THREADS = (32, 64, 96, 128, 192, 256)  # of GRiD's blocks, of which the best is taken
GRID_MOST = 102_400  # states that GRiD is compiled for
FRAX_MOST = 102_400  # states whose derivatives frax takes: a million ask for 61 GB
WARP_MOST = 1_024_000  # worlds of MuJoCo Warp, which keep kilobytes each
GRID_FUNCTIONS = {
    "inverse_dynamics": ("inverse_dynamics",),
    "forward_dynamics": ("forward_dynamics", "aba"),
    "forward_dynamics_jacobian": ("forward_dynamics_gradient",),
}


class Absent(Exception):
    """A contender that is not here, or that has no such function, dtype or number of states."""


@dataclass(frozen=True)
class Work:
    """A call: what begins it, what waits for all that was begun, and what gives the result.

    A result is (N, n), or of derivatives (N, 2, n, n).
    """

    begin: Callable[[], Any]
    wait: Callable[[], Any]
    result: Callable[[], Array]


Maker = Callable[[str, str, str, Sequence[Array]], Work]


@cache
def built(robot: str, dtype: str, checks: bool) -> tuple[Any, Any]:
    """Return a kernel and its methods on the device."""
    kernel = eomgen.build(robot, kernels=FUNCTIONS, dtype=dtype).replaced(checks=checks)
    return kernel, kernel.device("cuda")


def ours(
    robot: str, function: str, dtype: str, states: Sequence[Array], *, tiled: bool, checks: bool, bound: bool = False
) -> Work:
    """Make eomgen's call, which writes to an array that is there."""
    kernel, device = built(robot, dtype, checks)
    arrays = [np.moveaxis(x.reshape(-1, device.tile, kernel.n), 1, -1) if tiled else x for x in states]
    lying, method = [device.put(x) for x in arrays], getattr(device, function)
    shape = device.shapes(function)[1]["out"]
    whole = (len(arrays[0]), *shape, *arrays[0].shape[2:])  # of tiles with states behind
    out, one = device.put(np.zeros(whole, dtype)), device.put(np.zeros(1))

    def result() -> Array:
        made: Array = device.get(out)
        rows = np.moveaxis(made, -1, 1).reshape(-1, *shape) if tiled else made
        return rows[:, :BLOCKS] if len(shape) == 3 else rows

    begin = device.bind(function, *lying, out=out) if bound else lambda: method(*lying, out=out)
    return Work(begin, lambda: device.get(one), result)


def in_jax(robot: str, function: str, dtype: str, states: Sequence[Array]) -> Work:
    """Make eomgen's call inside a function of JAX that is compiled."""
    jax = _jax()
    from eomgen.adapters.jax import function as adapted

    if function == "forward_dynamics_jacobian":
        raise Absent("JAX takes derivatives by products with them")
    return _jitted(jax, adapted(built(robot, dtype, False)[1], function), states)


def frax(robot: str, function: str, dtype: str, states: Sequence[Array]) -> Work:
    """Make frax's call for all states, compiled by JAX."""
    if function == "forward_dynamics_jacobian" and len(states[0]) > FRAX_MOST:
        raise Absent(f"derivatives of more than {FRAX_MOST} states")
    jax = _jax()
    arm = _frax_robot(robot)
    upwards = jax.numpy.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0], dtype)

    def accelerations(q: Any, v: Any, u: Any) -> Any:
        return arm.forward_dynamics(q, v, u, None)

    def derivatives(q: Any, v: Any, u: Any) -> Any:
        return jax.numpy.stack(jax.jacfwd(accelerations, (0, 1))(q, v, u))

    functions = {
        "inverse_dynamics": lambda q, v, a: arm.rnea(q, v, a, upwards, None),
        "forward_dynamics": accelerations,
        "forward_dynamics_jacobian": derivatives,
    }
    return _jitted(jax, jax.vmap(functions[function]), states)


def grid(robot: str, function: str, dtype: str, states: Sequence[Array]) -> Work:
    """Make GRiD's call as a graph of CUDA, with its best algorithm and number of threads."""
    torch = _imported("torch")
    if len(states[0]) > GRID_MOST:
        raise Absent(f"more than {GRID_MOST} states")
    arm = _grid_robot(robot, dtype)
    tensors, found = [torch.as_tensor(x, device="cuda") for x in states], list[tuple[float, int, Any]]()
    for name in GRID_FUNCTIONS[function]:
        for threads in THREADS:
            arm.set_threads_per_block(threads)
            graph = arm.capture(name, *tensors, gravity=-GRAVITY)
            found.append((_seconds(torch, graph.replay), len(found), graph))
    best = min(found)[2]

    def result() -> Array:
        made: Array = best.static_out.cpu().numpy()
        count, n = states[0].shape
        return np.moveaxis(made.reshape(count, n, BLOCKS, n), 2, 1) if made.ndim == 3 else made

    return Work(best.replay, torch.cuda.synchronize, result)


def warp(robot: str, function: str, dtype: str, states: Sequence[Array]) -> Work:
    """Make MuJoCo Warp's call as a graph of CUDA, without constraints."""
    if dtype != "float32" or function == "forward_dynamics_jacobian":
        raise Absent("single precision alone, and no derivatives")
    if len(states[0]) > WARP_MOST:
        raise Absent(f"more than {WARP_MOST} states")
    mujoco, mjw, wp = _imported("mujoco"), _imported("mujoco_warp"), _imported("warp")
    model = mujoco.MjModel.from_xml_string(mjcf(as_robot(robot), 1e-3, "implicitfast"))
    bits = mujoco.mjtDisableBit
    for bit in (bits.mjDSBL_CONSTRAINT, bits.mjDSBL_CONTACT, bits.mjDSBL_ACTUATION, bits.mjDSBL_SENSOR):
        model.opt.disableflags |= bit
    there, data = mjw.put_model(model), mjw.make_data(model, nworld=len(states[0]), nconmax=1, njmax=1)
    given, asked = {"inverse_dynamics": ("qacc", "qfrc_inverse"), "forward_dynamics": ("qfrc_applied", "qacc")}[
        function
    ]
    for name, x in zip(("qpos", "qvel", given), states, strict=True):
        getattr(data, name).assign(x)
    run = {"inverse_dynamics": mjw.inverse, "forward_dynamics": mjw.forward}[function]
    run(there, data)
    with wp.ScopedCapture() as capture:
        run(there, data)
    return Work(lambda: wp.capture_launch(capture.graph), wp.synchronize, lambda: getattr(data, asked).numpy())


CONTENDERS: Mapping[str, Maker] = {
    "eomgen, rows": lambda *x: ours(*x, tiled=False, checks=True),
    "eomgen, tiles": lambda *x: ours(*x, tiled=True, checks=True),
    "eomgen, rows, bound": lambda *x: ours(*x, tiled=False, checks=False, bound=True),
    "eomgen, tiles, bound": lambda *x: ours(*x, tiled=True, checks=False, bound=True),
    "eomgen, rows, in JAX": in_jax,
    "GRiD": grid,
    "frax": frax,
    "MuJoCo Warp": warp,
}


def _imported(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise Absent(f"{name} is not installed: {error}") from None


def _jax() -> Any:
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")  # or others have no memory left
    jax = _imported("jax")
    jax.config.update("jax_enable_x64", True)
    if jax.default_backend() != "gpu":
        raise Absent("JAX is not one for CUDA")
    return jax


def _jitted(jax: Any, function: Callable[..., Any], states: Sequence[Array]) -> Work:
    made, arrays, last = jax.jit(function), [jax.device_put(x) for x in states], list[Any]([None])

    def begin() -> None:
        last[0] = made(*arrays)

    begin()
    return Work(begin, lambda: last[0].block_until_ready(), lambda: np.asarray(last[0]))


def _urdf(robot: str, folder: str) -> Path:
    """Write a robot for others; frax asks for a mass of its base, which stands still."""
    path, root = Path(folder, f"{robot}.urdf"), urdf_of(as_robot(robot))
    inertial = ElementTree.SubElement(root.findall("link")[0], "inertial")
    ElementTree.SubElement(inertial, "mass", value="1.0")
    moments = {"ixx": "1.0", "iyy": "1.0", "izz": "1.0", "ixy": "0.0", "ixz": "0.0", "iyz": "0.0"}
    ElementTree.SubElement(inertial, "inertia", moments)
    path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return path


@cache
def _frax_robot(robot: str) -> Any:
    module = _imported("frax.core.manipulator")
    with tempfile.TemporaryDirectory() as folder:
        return module.Manipulator(str(_urdf(robot, folder)))


@cache
def _grid_robot(robot: str, dtype: str) -> Any:
    """Return a robot of GRiD, whose CUDA is compiled when it is first asked for, which takes minutes."""
    module = _imported("grid_rbd")
    with tempfile.TemporaryDirectory() as folder:
        try:
            return module.register_robot(
                f"{robot}_{dtype}",
                str(_urdf(robot, folder)),
                backend="torch",
                dtype=dtype,
                max_batch_size=GRID_MOST,
                algorithm_list=[name for names in GRID_FUNCTIONS.values() for name in names],
                enable_mujoco_kernels=False,
            )
        except RuntimeError as error:
            raise Absent(f"GRiD does not compile: {str(error)[-300:]}") from None


def _seconds(torch: Any, run: Callable[[], Any], calls: int = 5) -> float:
    run()
    begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
    begin.record()
    for _ in range(calls):
        run()
    end.record()
    torch.cuda.synchronize()
    return float(begin.elapsed_time(end)) / calls
