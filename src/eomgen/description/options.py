"""Options of reading a robot as a record, from whose fields those of the command line are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict

from ..robot.inertia_policy import POLICIES
from .macros import Xacro

_INERTIA = (
    "an inertia that no body can have: refuse it, take it as it is, or take the nearest one (error for those of TOML,"
    " warn for those of a URDF or MJCF)"
)
_STOPS = "stops at all limits: stiffness=K, with damping, restitution_damping, smoothing behind commas"
_FLOATING = "put a free joint, floating_base, between the ground and the root link of a URDF"
_XACRO = "expand a .xacro file, which runs the Python that stands in it: for files that you trust"
_XACRO_ARGS = "with --xacro: value of an argument of the file, as xacro takes it, also without --xacro-arg"


class ReadKeywords(TypedDict, total=False):
    """Keywords of functions that read the text of a description: fields of ``ReadOptions``."""

    inertia: str | None
    urdf_damping: bool
    urdf_friction: bool
    urdf_mimic: bool
    stops: Mapping[str, float] | None
    floating_base: bool


@dataclass(frozen=True)
class ReadOptions:
    """Options of reading a robot, as of ``load_robot``; metadata have the command line's help of each."""

    inertia: str | None = field(default=None, metadata={"choices": POLICIES, "help": _INERTIA})
    urdf_damping: bool = field(default=False, metadata={"help": "read <dynamics damping=...> of a URDF"})
    urdf_friction: bool = field(
        default=False, metadata={"help": "read <dynamics friction=...> of a URDF, as Coulomb friction"}
    )
    urdf_mimic: bool = field(
        default=True,
        metadata={"option": "--urdf-no-mimic", "help": "read joints with <mimic> of a URDF as independent ones"},
    )
    stops: Mapping[str, float] | None = field(default=None, metadata={"metavar": "KEY=NUMBER,...", "help": _STOPS})
    floating_base: bool = field(default=False, metadata={"help": _FLOATING})
    xacro: Xacro = field(default=False, metadata={"help": _XACRO})
    xacro_args: Mapping[str, object] | None = field(
        default=None,
        metadata={"option": "--xacro-arg", "action": "append", "metavar": "NAME:=VALUE", "help": _XACRO_ARGS},
    )
