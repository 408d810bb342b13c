"""Pinocchio through its C++ headers, which the wheel ``pin`` brings, with Eigen's of the wheel ``cmeel-eigen``."""

from __future__ import annotations

import importlib.metadata
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eomgen.robot.value import COORDINATES, Robot

from .cases import Case
from .contender import FFI, Contender, MissingPeer, address, build_library

NAME = "Pinocchio"
SOURCE = Path(__file__).with_suffix(".cpp")
HEADER = SOURCE.with_name("pinocchio_model.hpp")
FLAGS = ("-O3", "-march=native")
OTHERS = (  # as Pinocchio's build sets them
    "-std=c++17",
    "-DNDEBUG",
    "-w",
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)
PARTS = (1, 2, 3, 4)  # of the source
LOCAL, WORLD = "Pinocchio (local)", "Pinocchio (world)"  # its two conventions; local is its default
CONTRACTED, TENSORS = "Pinocchio (contracted)", "Pinocchio (tensors)"  # with a vector, and what it has before that
CODE: Mapping[str, Mapping[str, str]] = {  # kernel -> label -> function
    "inverse_dynamics": {NAME: "pinocchio_inverse_dynamics"},
    "mass_matrix": {LOCAL: "pinocchio_mass_matrix", WORLD: "pinocchio_mass_matrix_world"},
    "forward_dynamics": {LOCAL: "pinocchio_forward_dynamics", WORLD: "pinocchio_forward_dynamics_world"},
    "derivatives": {NAME: "pinocchio_derivatives"},
    "forward_derivatives": {NAME: "pinocchio_forward_derivatives"},
    "second_derivatives": {CONTRACTED: "pinocchio_second_derivatives", TENSORS: "pinocchio_second_tensors"},
}

FFI.cdef("void *pinocchio_load(const char *text);")
for _name in (name for names in CODE.values() for name in names.values()):
    FFI.cdef(f"void {_name}(void);")  # an address is all that is used


def version() -> str:
    """Return the version of the wheel."""
    return importlib.metadata.version("pin")


def library(parts: Sequence[int] = PARTS, flags: Sequence[str] = FLAGS) -> Path:
    """Return the compiled peer, or some parts of its source; minutes the first time.

    Raises:
        MissingPeer: a header or the compiler is missing.
    """
    flags = (*flags, *compile_flags())
    compiled = [(*flags, f"-DPART={unit}", SOURCE.name) for unit in parts]
    return build_library("pinocchio_peer", cxx(), compiled, (), sources(SOURCE), versions())


def cxx() -> str:
    """Return the C++ compiler: $CXX or g++."""
    return os.environ.get("CXX", "") or "g++"


def compile_flags() -> tuple[str, ...]:
    """Return what every translation unit with Pinocchio's headers is compiled with.

    Raises:
        MissingPeer: a header is missing.
    """
    folders = (_include("pinocchio/multibody.hpp"), _eigen())
    return (*OTHERS, *(f"-I{folder}" for folder in folders))


def versions() -> tuple[str, ...]:
    """Return the versions of the headers."""
    text = (_eigen() / "Eigen/src/Core/util/Macros.h").read_text(encoding="utf-8")
    eigen = "".join(line for line in text.splitlines() if "define EIGEN_" in line and "_VERSION" in line)
    return version(), eigen


def sources(main: Path) -> dict[str, str]:
    """Return a source with the header that it shares."""
    return {path.name: path.read_text(encoding="ascii") for path in (main, HEADER)}


def _include(header: str) -> Path:
    for entry in sys.path:
        folder = Path(entry, "cmeel.prefix", "include")
        if (folder / header).exists():
            return folder
    raise MissingPeer("the wheel pin with its headers is not installed")


def _eigen() -> Path:
    for folder in (
        *(Path(entry, "cmeel.prefix", "include", "eigen3") for entry in sys.path),
        Path("/usr/include/eigen3"),
    ):
        if (folder / "Eigen" / "Core").exists():
            return folder
    raise MissingPeer("Eigen's headers are not installed (pip install cmeel-eigen, or Debian's libeigen3-dev)")


class PinocchioPeer:
    """A robot in Pinocchio: as it reads the URDF, or a chain of joints of one coordinate.

    Args:
        case: the robot.
        parts, flags: of the source, how they are compiled.
    """

    def __init__(self, case: Case, parts: Sequence[int] = PARTS, flags: Sequence[str] = FLAGS) -> None:
        self.text = model_text(case)
        self._library = FFI.dlopen(str(library(parts, flags)))
        self._model = self._library.pinocchio_load(self.text.encode())

    def contenders(self, kernel: str) -> list[Contender]:
        """Return Pinocchio's algorithm for a kernel, in each convention that it has."""
        return [
            Contender(
                label,
                address(FFI, FFI.addressof(self._library, name)),
                address(FFI, self._model),
                keeps_result=True,
                kept=self,
            )
            for label, name in CODE[kernel].items()
        ]


def model_text(case: Case) -> str:
    """Return what ``pinocchio_load`` reads.

    Raises:
        MissingPeer: the wheel is missing, or a joint is of a kind that the text has no line for.
    """
    try:
        import pinocchio as pin
    except ImportError:
        raise MissingPeer("the wheel pin is not installed") from None
    if case.urdf is not None:
        model = pin.buildModelFromUrdf(str(case.urdf))
    else:
        model = one_by_one(case.robot)
    rows = [" ".join(repr(float(x)) for x in row) for row in _rows(model)]
    gravity = " ".join(repr(float(x)) for x in model.gravity.linear)
    return "\n".join([gravity, str(len(rows)), *rows]) + "\n"


def coordinate_joints() -> dict[str, Any]:
    """Return Pinocchio's kind of joint for each of the six coordinates."""
    import pinocchio as pin

    kinds = (
        pin.JointModelPX,
        pin.JointModelPY,
        pin.JointModelPZ,
        pin.JointModelRX,
        pin.JointModelRY,
        pin.JointModelRZ,
    )
    return dict(zip(COORDINATES, kinds, strict=True))


def one_by_one(robot: Robot) -> Any:
    """Return a pinocchio.Model with a joint per coordinate, and no bodies in between: faster than its composite joints.

    Links are frames of it, by their names.
    """
    import pinocchio as pin

    kinds = coordinate_joints()
    model = pin.Model()
    model.gravity.linear = np.array(robot.gravity)
    where = {robot.base: (0, pin.SE3.Identity())}  # link -> (the last joint that moves it, its pose in that)
    for joint in robot.joints:
        at, pose = where[joint.parent]
        turn = pin.SE3(np.array(joint.axis_turn), np.zeros(3))
        pose = pose * pin.SE3(np.array(joint.placement.rotation), np.array(joint.placement.xyz)) * turn
        for name in joint.coordinates:
            at = model.addJoint(at, kinds[name](), pose, f"{joint.name}.{name}")
            pose = pin.SE3.Identity()
        where[joint.child] = at, pose = at, pose * turn.inverse()
        link = robot.link(joint.child)
        xx, yy, zz, xy, xz, yz = link.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        model.appendBodyToJoint(at, pin.Inertia(link.mass, np.array(link.com), tensor), pose)
    for name, (at, pose) in where.items():
        model.addFrame(pin.Frame(name, at, 0, pose, pin.FrameType.BODY))
    return model


def _rows(model: Any) -> Iterator[list[float]]:
    """Yield a joint per line: parent, kind, axis, rotation, origin, mass, com, inertia about it."""
    for i in range(1, model.njoints):
        joint, name = model.joints[i], model.joints[i].shortname()
        axis = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1)}.get(name.removeprefix("JointModel")[1:])
        if axis is None:
            if name not in ("JointModelRevoluteUnaligned", "JointModelPrismaticUnaligned"):
                raise MissingPeer(f"a joint of kind {name} is not passed on")
            axis = tuple(joint.extract().axis if hasattr(joint, "extract") else joint.axis)
        inertia, place = model.inertias[i], model.jointPlacements[i]
        yield [
            model.parents[i],
            float(not name.startswith("JointModelR")),
            *axis,
            *place.rotation.ravel(),
            *place.translation,
            inertia.mass,
            *inertia.lever,
            *inertia.inertia.ravel(),
        ]
