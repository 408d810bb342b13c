"""Robot -> what single precision costs it: bounds, observed errors, and what they come from.

stage                 input               output
derive_equations      Model, float32      Equations     programs that the C in float is rendered from
bound_program         Equations           bounds        over ranges; parameters as the description has them
observed_errors       both precisions     errors        beside double precision, at random states
shares                Model of all        parts         of the largest error, in the description's names
                      numbers
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..codegen.kernels.equations import Equations, derive_equations
from ..codegen.kernels.signatures import KERNELS, available
from ..codegen.program.mixed import in_double
from ..description import RobotLike, as_robot
from ..errors import UnknownNameError, check_kind
from ..names import show
from ..progress import StageReport, no_report, tells_at_prompt
from ..robot.model import Model, build_model
from ..robot.value import Robot
from .adjoints import contributions
from .advice_result import Float32Advice, Float32Errors, worst_output
from .bounds import NO_RANGES, Ranges, bound_program, enclosed, no_program
from .mixing import check_within, mixed
from .observed import observed_errors
from .ranges import check_ranges, chosen_ranges, deflections
from .sources import shares, with_parameters
from .units import output_units
from .whole import with_setup

ADVISED = (  # kernels that advice is given on unless others are named; those of loops where there are some
    "inverse_dynamics",
    "tree_inverse_dynamics",
    "forward_dynamics",
    "tree_forward_dynamics",
    "constrained_dynamics",
    "mass_matrix",
    "bias_force",
    "generalized_force",
    "gravity",
    "residual",
    "energy",
    "kinematics",
)

_P = ("p",)


@tells_at_prompt("bounding")
def float32_advice(
    robot: RobotLike,
    kernels: Sequence[str] = (),
    ranges: Ranges = NO_RANGES,
    *,
    within: float | None = None,
    progress: StageReport = no_report,
) -> Float32Advice:
    """Tell what single precision costs a robot: by how much its kernels' results are off, and what that comes from.

    Bounds are proved as by ``rounding_bound`` in "float32", beside exact results for the parameters as the description
    has them, and hold for all states of the ranges; states are numbers of single precision.  Observed errors are
    those of programs in float32 beside float64 at 256 random states.  Kernels that solve equations have these alone.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernels: names; of those that control and simulate if none is given.
        ranges: as of ``rounding_bound``.
        within: largest error by an output's size; instructions that contribute most are in double precision until
            bounds are within, as in packages of ``Options.within``.  None: all are in single precision.
        progress: called with a line of text when a kernel's turn comes.

    Raises:
        InputError: an unknown name, ends that are no range, or an error that single precision cannot be within.
    """
    robot = as_robot(robot)
    check_within(within, "float32")
    check_kind("kernels", kernels, isinstance(kernels, (list, tuple)), "a list of names of kernels")
    model = build_model(robot)
    check_ranges(model, ranges)
    known = available(model)
    for name in kernels:
        if name not in known:
            raise UnknownNameError(f"kernel {show(name)} is not one of this robot's; known: {', '.join(known)}")
    wanted = tuple(kernels) or tuple(name for name in ADVISED if name in known)
    progress("deriving equations")
    single, double = (derive_equations(model, wanted, dtype) for dtype in ("float32", "float64"))
    sources = _Sources(robot, ranges, within)
    if within is not None:
        progress("choosing instructions in double precision")
        single = mixed(single, within, ranges)
    found: dict[str, Float32Errors] = {}
    left_out: dict[str, str] = {}
    for name in wanted:
        if reason := no_program(single, name) or no_program(double, name):
            left_out[name] = reason
            continue
        progress(f"bounding {name}")
        found[name] = _errors(name, single, double, ranges, sources)
    return Float32Advice(robot=model.name, kernels=found, left_out=left_out)


def _errors(kernel: str, single: Equations, double: Equations, ranges: Ranges, sources: _Sources) -> Float32Errors:
    """Bound and observe the errors of a kernel, and name the sources of the worst."""
    model, solves = single.model, KERNELS[kernel].solves
    made = bound_program(single, kernel, ranges, "float32", _P) if not solves else None
    names = enclosed(single, kernel, ranges, "float32", _P).names if made is None else made.outputs
    narrow, wide = (with_setup(equations.programs[kernel], equations.setup) for equations in (single, double))
    chosen = chosen_ranges(model, KERNELS[kernel].reads, ranges, "float32")
    observed, size = observed_errors(model, narrow, wide, chosen, deflections(model, ranges), len(names))
    nothing = np.full(len(names), np.nan)
    bound = nothing if made is None else made.bound
    worst = worst_output(observed if made is None else bound, size)
    parts, of_inputs = sources.of(kernel, worst) if made is not None and worst is not None else ({}, 0.0)
    return Float32Errors(
        kernel=kernel,
        outputs=names,
        units=output_units(model, kernel, names),
        bound=bound,
        observed=observed,
        size=size,
        instruction=("",) * len(names) if made is None else made.worst,
        refused={} if made is None else made.refused,
        worst=None if worst is None else names[worst],
        sources=parts,
        of_inputs=of_inputs,
        operations=sum(bool(args) for _, args, _ in single.programs[kernel].instructions),
        in_double=len(in_double(single.programs[kernel])),
        ranges={} if made is None else made.ranges,
    )


class _Sources:
    """Sources of bounds, by a derivation in which all numbers of the robot are parameters."""

    def __init__(self, robot: Robot, ranges: Ranges, within: float | None) -> None:
        self.robot, self.ranges, self.within = robot, ranges, within
        self.model: Model | None = None

    def of(self, kernel: str, output: int) -> tuple[Mapping[str, float], float]:
        """Return the sources of an output's bound with their parts, and what states held in float32 add to it."""
        if self.model is None:
            self.model = build_model(with_parameters(self.robot))
        equations = derive_equations(self.model, (kernel,), "float32")
        if self.within is not None:
            equations = mixed(equations, self.within, self.ranges)
        arrays = (*_P, *KERNELS[kernel].reads)
        made = enclosed(equations, kernel, self.ranges, "float32", arrays)
        if output not in made.with_bounds:
            return {}, 0.0
        parts = contributions(made.found, [made.places[output]])[:, 0]
        leaves = [(op, leaf) for op, _, leaf in made.program.instructions]
        states = np.array([op == "input" and leaf[0] != "p" for op, leaf in leaves], bool)
        of_inputs = float(parts[states].sum())
        return shares(self.model, made.program, np.where(states, 0.0, parts)), of_inputs
