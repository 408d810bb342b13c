"""Loads of a scenario: wrenches on links over time, and bodies that links pick up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Array
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import LinkWrench
from ..names import parameter_name
from ..robot.model import build_model
from ..robot.value import INERTIA_KEYS, Link, Robot
from ..scenario.value import Scenario, Wrench

_AXES = "xyz"


def check_loads(scenario: Scenario, robot: Robot) -> None:
    """Raise DescriptionError if a wrench or payload is on a link that the robot lacks, or that does not move."""
    links = build_model(robot).links
    for key in ("wrenches", "payloads"):
        for i, load in enumerate(getattr(scenario, key)):
            if load.link not in links:
                scenario.refuse(f"{key}[{i}].link", load.link, links, "is no moving link")


class Wrenches:
    """The wrenches of a scenario: (t, q, v) -> (links, 6), as kernels take them: about centres of mass, base frame.

    The centre of mass is that of the link with what it carries.
    """

    def __init__(self, scenario: Scenario, robot: Robot, kernel: Kernel) -> None:
        self._wrenches = scenario.wrenches
        self._kernel = kernel
        self._com = {wrench.link: np.array(robot.link(wrench.link).com) for wrench in scenario.wrenches}

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        total = np.zeros((len(self._kernel.links), 6))
        for wrench in self._wrenches:
            if wrench.t0 <= t and (wrench.t1 is None or t < wrench.t1):
                total[self._kernel.links.index(wrench.link)] += self._of(wrench, t, q)
        return total

    def load_data(self) -> list[LinkWrench]:
        """Return the time-signal inputs for integrations in C, about centres of mass with the current parameters."""
        return [self._data_of(wrench) for wrench in self._wrenches]

    def _data_of(self, wrench: Wrench) -> LinkWrench:
        arm = np.zeros(3) if wrench.point is None else np.array(wrench.point) - self._center(wrench.link)
        link, until = self._kernel.links.index(wrench.link), np.inf if wrench.t1 is None else wrench.t1
        return LinkWrench(link, wrench.table.as_signal(), arm, wrench.t0, until, wrench.axes == "link")

    def _of(self, wrench: Wrench, t: float, q: Array) -> Array:
        row = wrench.table.at(t)
        force, moment = row[:3], row[3:]
        if wrench.axes == "base" and wrench.point is None:
            return row
        R_0k = self._kernel.frame_pose(q, wrench.link)[:3, :3]
        if wrench.axes == "link":
            force, moment = R_0k @ force, R_0k @ moment
        if wrench.point is not None:
            moment = moment + np.cross(R_0k @ (np.array(wrench.point) - self._center(wrench.link)), force)
        return np.concatenate([force, moment])

    def _center(self, link: str) -> Array:
        com = self._com[link]
        names = [parameter_name("links", link, "com", axis) for axis in _AXES]
        return np.array([self._kernel.parameters.get(name, x) for name, x in zip(names, com, strict=True)])


def with_payload_parameters(robot: Robot, scenario: Scenario) -> Robot:
    """Return the robot with tunable inertia of links that pick something up; the same robot without any."""
    names = [
        name
        for link in dict.fromkeys(load.link for load in scenario.payloads)
        for name in body_parameters(robot.link(link))
    ]
    if not names:
        return robot
    return Robot(**{**vars(robot), "tunable": tuple(dict.fromkeys((*robot.tunable, *names)))})


def body_parameters(link: Link) -> dict[str, float]:
    """Return mass, centre of mass and inertia by the names of parameters."""
    names = ["mass", *(f"com.{axis}" for axis in _AXES), *(f"inertia.{key}" for key in INERTIA_KEYS)]
    values = (link.mass, *link.com, *link.inertia)
    return {parameter_name("links", link.name, key): x for key, x in zip(names, values, strict=True)}


def loaded_parameters(robot: Robot, scenario: Scenario, t: float) -> dict[str, float]:
    """Return parameters of all links that ever carry something, with what they carry at a time."""
    parameters: dict[str, float] = {}
    for name in dict.fromkeys(load.link for load in scenario.payloads):
        carried = [
            Link("payload", load.mass, load.point, load.inertia)
            for load in scenario.payloads
            if load.link == name and load.t0 <= t and (load.t1 is None or t < load.t1)
        ]
        parameters |= body_parameters(combined_body(robot.link(name), carried))
    return parameters


def combined_body(link: Link, others: Sequence[Link]) -> Link:
    """Return the rigid body that a link and others, expressed in its frame, form together."""
    if not others:
        return link
    bodies = (link, *others)
    masses, places = np.array([body.mass for body in bodies]), np.array([body.com for body in bodies])
    com = masses @ places / masses.sum()
    total = np.zeros((3, 3))
    for body, d in zip(bodies, places - com, strict=True):
        xx, yy, zz, xy, xz, yz = body.inertia
        total += np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        total += body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = total.tolist()
    x, y, z = com.tolist()
    return Link(link.name, float(masses.sum()), (x, y, z), (xx, yy, zz, xy, xz, yz))
