"""Discrete dynamics x+ = F(x, u, p): steps of one length with their derivatives, as C for predictive control.

``templates/control/step.c.jinja`` has the C; adapters and exports put faces of other people's tools around it.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..codegen.kernels.derived import METHODS
from ..codegen.kernels.groups import ACCELERATION_SLOPES
from ..errors import InputError, UnknownNameError
from ..kernel.complete import Kernel
from ..kernel.stepping.methods import STEP_CODES
from ..names import listed, show

LONGEST = 1e6  # s, of a step
MOST_SUBSTEPS = 10_000
[SLOPES] = ACCELERATION_SLOPES  # spares "rk4" directions, where a kernel has it


def kernels_for_step(method: str = "rk4", *, closed: bool = False) -> tuple[str, ...]:
    """Return names of the kernels that a step by a method takes, for ``eomgen.build(robot, kernels=...)``.

    Args:
        method: of STEP_CODES.
        closed: of a robot with loops or rigid couplings, whose steps by "rk4" take no Jacobian of accelerations.

    Raises:
        InputError: no such method.
    """
    if method not in STEP_CODES:
        raise InputError(f"method: {show(method)} has no derivatives; allowed: {', '.join(STEP_CODES)}")
    way = STEP_CODES[method][0]
    needed = (METHODS[way][1], f"{way}_gradient", f"{way}_sensitivity")
    return (*needed, SLOPES) if method == "rk4" and not closed else needed


def checked_step(
    method: str, dt: object, substeps: object, parameters: Sequence[str], known: Iterable[str]
) -> tuple[float, int, tuple[str, ...]]:
    """Return length, number of substeps and names of parameters of a step, for what is known before a kernel is built.

    Args:
        method: of the step.
        dt: its length, s.
        substeps: equal ones that it is made of.
        parameters: names of those in p.
        known: names of the robot's run-time parameters.

    Raises:
        InputError: no such method, length or number of substeps; a name twice.
        UnknownNameError: no such parameter.
    """
    kernels_for_step(method)
    return _length(dt), _count(substeps), _names("parameters", parameters, tuple(known))


@dataclass(frozen=True)
class DiscreteStep:
    """A step of a robot's motion as a function of the state x at its beginning, drives u and parameters p.

    x is q, then v with internal states behind it; drives are held, and parameters which are not named are those of
    the kernel now.

    Attributes:
        kernel: of the robot.
        method: "rk4", "tsit5", "implicit" or "rosenbrock".
        dt: length of the step, s.
        substeps: equal ones that it is made of.
        drives: names of the coordinates that u acts on, in its order; None: those that have drives.
        parameters: names of the run-time parameters in p, in its order.

    Raises:
        InputError: no such method, length, number of substeps or drive; or joints with 3-DOF rotation.
        UnknownNameError: no such parameter, or the kernel was built without the method's derivatives.
    """

    kernel: Kernel
    method: str
    dt: float
    substeps: int = 1
    drives: Sequence[str] | None = None
    parameters: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Check every field, and complete ``drives``."""
        kernel = self.kernel
        wanted = kernels_for_step(self.method, closed=True)
        missing = [name for name in wanted if name not in kernel.operations]
        if missing:
            raise UnknownNameError(
                f"step: {kernel.name} was built without {', '.join(missing)}; allowed: kernels={wanted!r}"
            )
        if kernel.raw.turning:
            joints = ", ".join(kernel.raw.turning)
            raise InputError(f"step: {joints} have 3-DOF rotation; allowed: robots without such joints")
        dt, substeps, parameters = checked_step(self.method, self.dt, self.substeps, self.parameters, kernel.parameters)
        object.__setattr__(self, "dt", dt)
        object.__setattr__(self, "substeps", substeps)
        object.__setattr__(self, "parameters", parameters)
        driven: Sequence[int] = kernel.raw.libraries.meta["driven"]
        given = [kernel.coordinates[i] for i in driven] if self.drives is None else self.drives
        object.__setattr__(self, "drives", _names("drives", given, kernel.coordinates))

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the numbers of x: those of coordinates, then those of velocities, with internal states behind."""
        return (*self.kernel.coordinates, *self.kernel.coordinates, *self.kernel.internal_states)

    @property
    def sizes(self) -> dict[str, int]:
        """Numbers of x, u and, where there are any, p, by their names."""
        sizes = {"x": len(self.states), "u": len(self.drives or ())}
        return sizes | ({"p": len(self.parameters)} if self.parameters else {})

    @cached_property
    def together(self) -> Kernel:
        """The kernel with all that the step takes in one library of C."""
        needed = kernels_for_step(self.method, closed=True)
        needed = (*needed, SLOPES) if self._takes_slopes else needed
        return self.kernel.replaced(together=needed)

    @property
    def _takes_slopes(self) -> bool:
        """Whether derivatives by x and u come from those of accelerations: of explicit steps of trees."""
        return self.method == "rk4" and not self.kernel.constraints and SLOPES in self.kernel.operations

    def context(self, *, by_parameters: bool = True, adjoint: bool = True) -> dict[str, Any]:
        """Return what ``control/step.c.jinja`` asks for.

        Args:
            by_parameters: whether there are derivatives by p, too.
            adjoint: whether there are products of derivatives with weights of states.
        """
        kernel, (way, number) = self.together, STEP_CODES[self.method]
        gradient = kernel.raw.gradients[f"{way}_gradient"].library
        names, places = list(kernel.parameters), list(kernel.coordinates)
        n, rates, inputs = kernel.n, kernel.calls.rates, kernel.calls.inputs
        every, kept = max(len(names), 1), gradient.meta["kept"][f"{way}_gradient"]
        sizes = self.sizes
        by_parameters &= bool(self.parameters)
        directions = sizes["x"] + sizes["u"] + (len(self.parameters) if by_parameters else 0)
        setup = kernel.parameters.setup.computed(gradient)
        by_matrices = self._takes_slopes and not by_parameters
        room = inputs + (every + len(setup) if self.parameters else 0)  # rows of states begin behind it
        along = 2 * (1 + directions) * sizes["x"] + directions * (inputs + every)
        if by_matrices:
            along = 3 * (1 + directions) * sizes["x"] + directions * rates + 3 * rates**2 + kept
        return {
            "robot": kernel.name,
            "way": way,
            "number": number,
            "method": self.method,
            "dt": repr(self.dt / self.substeps),
            "length": repr(self.dt),
            "substeps": self.substeps,
            "n": n,
            "rates": rates,
            "drive_inputs": inputs,
            "states": sizes["x"],
            "drives": [places.index(name) for name in self.drives or ()],
            "parameters": [names.index(name) for name in self.parameters],
            "by_parameters": by_parameters,
            "adjoint": adjoint,
            "by_matrices": by_matrices,
            "every": every,
            "directions": directions,
            "hoisted": len(setup),
            "kept": kept,
            "setup": [literal(x) for x in setup],
            "values": [literal(float(x)) for x in kernel.parameters.values()],
            "room": {
                "value": room + 2 * sizes["x"],
                "jacobian": room + along,
                "adjoint": room + (self.substeps + 3) * sizes["x"] + inputs + self.substeps * kept + every,
            },
        }


def literal(number: float) -> str:
    """Write a number as C has it."""
    if math.isfinite(number):
        return repr(float(number))
    return "NAN" if math.isnan(number) else "HUGE_VAL" if number > 0.0 else "-HUGE_VAL"


def _length(dt: object) -> float:
    try:
        length = float(operator.attrgetter("real")(dt)) if not isinstance(dt, (bool, str)) else math.nan
    except (AttributeError, TypeError, ValueError):
        length = math.nan
    if not np.finfo(float).tiny <= length <= LONGEST:
        raise InputError(f"dt: {show(dt)} is no length of a step, s; allowed: a number above 0, up to {LONGEST:g}")
    return length


def _count(substeps: object) -> int:
    if isinstance(substeps, bool) or not isinstance(substeps, (int, np.integer)) or not 1 <= substeps <= MOST_SUBSTEPS:
        raise InputError(f"substeps: {show(substeps)}; allowed: a whole number from 1 to {MOST_SUBSTEPS}")
    return int(substeps)


def _names(label: str, given: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    if isinstance(given, str):
        raise InputError(f"{label}: {show(given)} is one name; allowed: a sequence of names")
    names = tuple(given)
    for i, name in enumerate(names):
        if name not in known:
            raise UnknownNameError(f"{label}: {show(name)} is unknown; allowed: {listed(known)}")
        if name in names[:i]:
            raise InputError(f"{label}: {show(name)} stands there twice; allowed: each once")
    return names
