"""A robot with other numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from eomgen.robot.value import COORDINATE_NUMBERS, COORDINATES, INERTIA_KEYS, LINEAR, Coordinate, Placement, Robot


def changed(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The description with other numbers, and nothing tunable."""

    def number(name: str, old: float | None) -> float | None:
        return values.get(name, old)

    def triple(prefix: str, old: tuple[float, ...], keys: Any) -> Any:
        return tuple(number(f"{prefix}.{key}", value) for key, value in zip(keys, old, strict=True))

    def placed(owner: str, old: Placement) -> Placement:
        xyz = triple(f"{owner}.placement.xyz", old.xyz, range(3))
        if old.rpy is None:
            return Placement(xyz, old.rotation)
        return Placement.from_rpy(xyz, triple(f"{owner}.placement.rpy", old.rpy, range(3)))

    def coordinate(owner: str, old: Coordinate) -> Coordinate:
        return Coordinate(**{key: number(f"{owner}.{key}", getattr(old, key)) for key in COORDINATE_NUMBERS})

    links = [
        replace(
            link,
            mass=number(f"links.{link.name}.mass", link.mass),
            com=triple(f"links.{link.name}.com", link.com, LINEAR),
            inertia=triple(f"links.{link.name}.inertia", link.inertia, INERTIA_KEYS),
        )
        for link in robot.links
    ]
    joints = [
        replace(
            joint,
            placement=placed(f"joints.{joint.name}", joint.placement),
            coordinates={k: coordinate(f"joints.{joint.name}.{k}", c) for k, c in joint.coordinates.items()},
            offset=tuple(
                number(f"joints.{joint.name}.offset.{key}", value)
                for key, value in zip(COORDINATES, joint.offset, strict=True)
            ),
        )
        for joint in robot.joints
    ]
    frames = [replace(frame, placement=placed(f"frames.{frame.name}", frame.placement)) for frame in robot.frames]
    return replace(
        robot,
        gravity=triple("gravity", robot.gravity, LINEAR),
        links=tuple(links),
        joints=tuple(joints),
        frames=tuple(frames),
        tunable=(),
    )
