"""Values of MJCF: numbers, flags and orientations of an element, each refusal with its place."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from eomgen.errors import DescriptionError
from eomgen.limits import LARGEST
from eomgen.names import listed, nearest, show
from eomgen.robot.geometry import Matrix, Vector, snap
from eomgen.robot.value import Placement

from ..draft import Draft
from ..xml_text import NUMBER

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

Array = NDArray[np.float64]
Named = TypeVar("Named")
TURNS = ("axisangle", "xyaxes", "zaxis", "euler")  # which MuJoCo takes before a quat
ORIENTATIONS = ("quat", *TURNS)
_SMALL = 1e-12  # shortest direction


@dataclass
class Reading:
    """State that all elements of a file share: the draft, the element being read, and how angles are written."""

    draft: Draft
    at: Element
    angle: float = math.pi / 180.0  # rad of the file's unit
    eulerseq: str = "xyz"


@dataclass(frozen=True)
class Pose:
    """Origin (m) and axes (columns) of one frame in another."""

    rotation: Array
    xyz: Array

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(tidy(self.rotation @ other.rotation), self.xyz + self.rotation @ other.xyz)

    def point(self, xyz: Array) -> Array:
        """Transform a point of the placed frame, m."""
        return np.asarray(self.xyz + self.rotation @ xyz)

    def placement(self) -> Placement:
        """Return it as a Placement of a Robot."""
        return Placement(triple(self.xyz), matrix(self.rotation))


HERE = Pose(np.eye(3), np.zeros(3))


def tidy(rotation: Array) -> Array:
    """Return the rotation with round-off about -1, 0 and 1 removed, which prunes the equations."""
    nearest_integer = np.round(rotation)
    return np.where(np.abs(rotation - nearest_integer) < 4e-16, nearest_integer, rotation) + 0.0


def triple(values: Array) -> Vector:
    """Return three floats, without negative zeros."""
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z


def matrix(values: Array) -> Matrix:
    """Return nine floats as rows."""
    a, b, c = (triple(row) for row in values)
    return a, b, c


class NeedsMujoco(DescriptionError):
    """A refusal of elements that become plain bodies, joints and masses when MuJoCo compiles the model."""


class Item:
    """An element with its attributes and those of its default class.

    Args:
        allowed: names of attributes; any other is refused.
        values: all attributes, where a default class adds to the element's.
    """

    def __init__(
        self,
        reading: Reading,
        element: Element,
        where: str,
        allowed: Collection[str] | None = None,
        values: Mapping[str, str] | None = None,
    ) -> None:
        self.reading, self.element, self.where = reading, element, where
        self.values = element.attrib if values is None else values
        reading.at = element
        if allowed is None:
            return
        for key in element.attrib:
            if key not in allowed:
                self.fail(
                    f"unknown attribute {show(key)}{nearest(key, allowed)} (allowed: {', '.join(sorted(allowed))})"
                )

    def fail(self, message: str) -> NoReturn:
        """Raise the DescriptionError of this element."""
        self.reading.at = self.element
        self.reading.draft.fail(self.where, message)

    def leave(self, message: str) -> NoReturn:
        """Raise the DescriptionError of this element, for something that MuJoCo compiles into plain elements."""
        self.reading.at = self.element
        raise NeedsMujoco(message, where=self.where, source=self.reading.draft.source)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def _from(self, key: str) -> str:
        return "" if key in self.element.attrib else " (by its default class)"

    def numbers(self, key: str, least: int, most: int | None = None) -> list[float]:
        """Return ``least`` to ``most`` finite numbers; none where the attribute is absent."""
        if key not in self.values:
            return []
        most = least if most is None else most
        text = self.values[key]
        words = text[: 32 * 1024].split()
        if not least <= len(words) <= most:
            count = f"{least} numbers" if least == most else f"{least} to {most} numbers"
            count = "a number" if most == 1 else count
            self.fail(f"{key} is {show(text)}{self._from(key)}; allowed: {count}")
        return [self._float(word, key) for word in words]

    def _float(self, text: str, key: str) -> float:
        value = float(text) if NUMBER.fullmatch(text) else math.nan
        if not abs(value) <= LARGEST:
            allowed = f"a finite number of magnitude up to {LARGEST:g}"
            self.fail(f"{key} is {show(text)}{self._from(key)}; allowed: {allowed}")
        return value + 0.0  # turns -0.0 into 0.0

    def number(self, key: str, default: float = 0.0, minimum: float | None = None) -> float:
        """Return a finite number."""
        numbers = self.numbers(key, 1)
        if not numbers:
            return default
        if minimum is not None and numbers[0] < minimum:
            self.fail(f"{key} is {numbers[0]:g}{self._from(key)}; allowed: a number that is at least {minimum:g}")
        return numbers[0]

    def vector(self, key: str, default: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
        """Return three numbers, (3,)."""
        return np.array(self.numbers(key, 3) or default, dtype=float)

    def choice(self, key: str, allowed: Sequence[str], default: str) -> str:
        """Return one of a few words."""
        value = self.values.get(key, default)
        if value not in allowed:
            self.fail(f"{key} is {show(value)}{self._from(key)}; allowed: {', '.join(allowed)}")
        return value

    def named(self, key: str, known: Mapping[str, Named], what: str, default: str = "") -> Named:
        """Return the value under the name in an attribute; ``what``: "such site", say, for messages."""
        text = self.values.get(key, default)
        if text not in known:
            message = f"{key} is {show(text)}, and there is no {what}{nearest(text, known)}"
            self.fail(f"{message} (allowed: {listed(known)})")
        return known[text]

    def flag(self, key: str, default: bool = False) -> bool:
        """Return the truth value of an attribute, true or false."""
        return self.choice(key, ("true", "false"), "true" if default else "false") == "true"

    def pose(self) -> Pose:
        """Return the pose of pos and orientation."""
        return Pose(self.rotation(), self.vector("pos"))

    def line(self) -> tuple[Pose, float]:
        """Return pose and half length (m) of fromto.

        z points from the second point to the first: so MuJoCo has it, although its documentation says the opposite.
        """
        ends = np.array(self.numbers("fromto", 6))
        first, second = ends[:3], ends[3:]
        length = math.hypot(*(second - first))
        if length < _SMALL:
            self.fail(f"fromto is {show(self.values['fromto'])}{self._from('fromto')}; allowed: two points apart")
        return Pose(tidy(onto((first - second) / length)), 0.5 * (first + second)), 0.5 * length

    def direction(self, key: str, default: Sequence[float]) -> Array:
        """Return a unit vector, (3,)."""
        return self._unit(self.vector(key, default), key)

    def _unit(self, value: Array, key: str) -> Array:
        length = math.hypot(*value)
        if length < _SMALL:
            self.fail(f"{key} is {show([float(x) for x in value])}{self._from(key)}; allowed: one that has a direction")
        return np.array([snap(float(x)) for x in value / length]) + 0.0

    def rotation(self) -> Array:
        """Return the element's axes as columns, (3, 3), from quat, axisangle, xyaxes, zaxis or euler."""
        local = [key for key in ORIENTATIONS if key in self.element.attrib]
        if len(local) > 1:
            self.fail(f"the attributes {local[0]} and {local[1]} are both set; allowed: one orientation")
        inherited = [key for key in TURNS if key in self.values and key not in local]
        if local == ["quat"] and inherited:
            message = f"quat is set here, and {inherited[0]} by its default class, which MuJoCo takes before it"
            self.fail(f"{message}; allowed: {inherited[0]} here, too")
        keys = local or inherited or [key for key in ORIENTATIONS if key in self.values]
        return tidy(getattr(self, f"_{keys[0]}")()) if keys else np.eye(3)

    def _quat(self) -> Array:
        quat = np.array(self.numbers("quat", 4))
        length = math.hypot(*quat)
        if length < _SMALL:
            self.fail(f"quat is {show(self.values['quat'])}; allowed: four numbers w x y z that are not all 0")
        return self.turned(quat / length)

    @staticmethod
    def turned(quat: Array) -> Array:
        """Return the rotation of a quaternion w, x, y, z that is not 0, (3, 3)."""
        w, x, y, z = quat / math.hypot(*quat)
        return np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )

    def _axisangle(self) -> Array:
        x, y, z, angle = self.numbers("axisangle", 4)
        return about(self._unit(np.array([x, y, z]), "axisangle"), angle * self.reading.angle)

    def _xyaxes(self) -> Array:
        values = self.numbers("xyaxes", 6)
        x = self._unit(np.array(values[:3]), "xyaxes")
        y = np.array(values[3:])
        y = self._unit(y - x * (x @ y), "xyaxes")
        return np.column_stack([x, y, np.cross(x, y)])

    def _zaxis(self) -> Array:
        return onto(self._unit(np.array(self.numbers("zaxis", 3)), "zaxis"))

    def _euler(self) -> Array:
        """Return the rotation of euler: small letters are intrinsic rotations, capital ones extrinsic."""
        result = np.eye(3)
        for letter, angle in zip(self.reading.eulerseq, self.numbers("euler", 3), strict=True):
            turn = about(np.eye(3)["xyz".index(letter.lower())], angle * self.reading.angle)
            result = result @ turn if letter.islower() else turn @ result
        return result


def about(axis: Array, angle: float) -> Array:
    """Return the rotation by an angle (rad) about a unit vector, (3, 3)."""
    c, s = snap(math.cos(angle)), snap(math.sin(angle))
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis)


def onto(direction: Array) -> Array:
    """Return the least rotation of z onto a unit vector; about x where they are opposite."""
    axis, c = np.cross([0.0, 0.0, 1.0], direction), direction[2]
    s = math.hypot(*axis)
    if s < 1e-15:
        return np.eye(3) if c > 0 else np.diag([1.0, -1.0, -1.0])
    return about(axis / s, math.atan2(s, c))
