"""The robots that are measured."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import eomgen
from eomgen.errors import EomgenWarning
from eomgen.robot.value import Robot

from ..run import generic, six
from .contender import MissingPeer

FOLDER = "cmeel.prefix/share/example-robot-data/robots"
URDFS: Mapping[str, str] = {
    "UR5": "ur_description/urdf/ur5_robot.urdf",
    "Panda": "panda_description/urdf/panda.urdf",
    "Talos": "talos_data/robots/talos_reduced.urdf",
}
CHAIN = "chain"  # the 36-DOF chain: puma560_generic with six coordinates in every joint
ELASTIC = "elastic arm"
TITLES: Mapping[str, str] = {
    "UR5": "UR5 URDF",
    "Panda": "Panda URDF",
    "Talos": "Talos reduced",
    CHAIN: "chain of 6-DOF joints",
    ELASTIC: "elastic PUMA 560",
}
GROWING = (1, 2, 3, 4, 6, 9, 12)  # joints of the chains in the plot


@dataclass(frozen=True)
class Case:
    """A robot, with the URDF that it was read from if peers are to read that too."""

    key: str
    robot: Robot
    urdf: Path | None = None

    @property
    def coordinates(self) -> int:
        return sum(len(joint.coordinates) for joint in self.robot.joints)

    @property
    def title(self) -> str:
        return f"{TITLES[self.key]} ({self.coordinates} DOF)"


@cache
def case(key: str) -> Case:
    """Return a case by its key in ``TITLES``.

    Raises:
        MissingPeer: it is a URDF of example-robot-data, which is not installed.
    """
    if key == ELASTIC:
        return Case(key, eomgen.load_robot("puma560_elastic"))
    if key == CHAIN:
        return chain(6)
    paths = [path for entry in sys.path if (path := Path(entry, FOLDER, URDFS[key])).exists()]
    if not paths:
        raise MissingPeer("the wheel example-robot-data is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)  # what is said of inertias and dampings; results are compared
        robot = eomgen.load_robot(paths[0], inertia="warn", urdf_mimic=False)  # peers read joints that mimic as free
    return Case(key, robot, paths[0])


def chain(joints: int) -> Case:
    """Return a serial chain of 6-DOF joints: those of puma560_generic, again and again."""
    arm = six(generic("puma560_generic"))
    made, links, parent = [], [], arm.base
    for i in range(joints):
        joint = arm.joints[i % len(arm.joints)]
        link = replace(arm.link(joint.child), name=f"link{i + 1}")
        made.append(replace(joint, name=f"joint{i + 1}", parent=parent, child=link.name))
        links.append(link)
        parent = link.name
    robot = replace(arm, name=f"chain{joints}", joints=tuple(made), links=tuple(links), frames=(), tunable=())
    return Case(CHAIN, robot)
