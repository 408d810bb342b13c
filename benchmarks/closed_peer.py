"""Pinocchio's dynamics of mechanisms with loops, from its C++ headers: ``constraintDynamics`` and ``lcaba``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eomgen.robot.value import Robot

from .peers import pinocchio_peer
from .peers.cases import Case
from .peers.contender import FFI, Contender, MissingPeer, address, build_library

SOURCE = Path(__file__).with_suffix(".cpp")
DYNAMICS, LCABA = "constraintDynamics", "lcaba"
CODE: Mapping[str, str] = {DYNAMICS: "closed_constraint_dynamics", LCABA: "closed_lcaba"}
ROWS: Mapping[str, int] = {"spherical": 3, "revolute": 3, "fixed": 6}  # in a plane a revolute joint closes as a point

FFI.cdef(
    "void *closed_load(const char *model, const char *loops, double mu, double accuracy, int iterations);"
    "int closed_iterations(const double *h);"
)
for _name in CODE.values():
    FFI.cdef(f"void {_name}(void);")


@dataclass(frozen=True)
class Settings:
    """Of Pinocchio's proximal iteration: its regularisation, the residual that ends it, iterations at most."""

    mu: float
    accuracy: float
    iterations: int


def library() -> Path:
    """Return the compiled peer; minutes the first time.

    Raises:
        MissingPeer: a header or the compiler is missing.
    """
    flags = (*pinocchio_peer.FLAGS, *pinocchio_peer.compile_flags())
    parts = [(*flags, f"-DPART={i + 1}", SOURCE.name) for i in range(2)]
    sources = pinocchio_peer.sources(SOURCE)
    return build_library("closed_peer", pinocchio_peer.cxx(), parts, (), sources, pinocchio_peer.versions())


class ClosedPeer:
    """A robot with spherical and fixed cut joints, or revolute ones in a plane, in Pinocchio."""

    def __init__(self, robot: Robot) -> None:
        self.model = pinocchio_peer.model_text(Case(robot.name, robot)).encode()
        self.loops = loops_text(robot).encode()
        self._library = FFI.dlopen(str(library()))

    def contender(self, algorithm: str, settings: Settings) -> Contender:
        """Return an algorithm with its settings, initialised once."""
        h = self._library.closed_load(self.model, self.loops, settings.mu, settings.accuracy, settings.iterations)
        code = address(FFI, FFI.addressof(self._library, CODE[algorithm]))
        return Contender(algorithm, code, address(FFI, h), keeps_result=True, kept=(self, h))

    def iterations(self, contender: Contender) -> int:
        """Return the most iterations that a state has taken so far."""
        return int(self._library.closed_iterations(FFI.cast("double *", contender.h)))


def loops_text(robot: Robot) -> str:
    """Return what ``closed_load`` reads of the loops.

    Raises:
        MissingPeer: Pinocchio has no such joint to close.
    """
    for loop in robot.loops:
        if loop.type not in ROWS:
            raise MissingPeer(f"Pinocchio closes no {loop.type} joint")
    model = pinocchio_peer.one_by_one(robot)
    lines = [str(len(robot.loops))]
    for loop in robot.loops:
        lines.append(str(ROWS[loop.type]))
        lines += [f"{joint} {' '.join(repr(float(x)) for x in numbers)}" for joint, numbers in _sides(model, loop)]
    return "\n".join(lines) + "\n"


def _sides(model: Any, loop: Any) -> Iterator[tuple[int, list[float]]]:
    """Yield the joint, and rotation and origin, of both frames of a cut joint."""
    import pinocchio as pin

    for link, placement in zip(loop.links, loop.placements, strict=True):
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        pose = frame.placement * pin.SE3(np.array(placement.rotation), np.array(placement.xyz))
        yield int(frame.parentJoint), [*pose.rotation.ravel(), *pose.translation]
