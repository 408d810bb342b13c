"""Notes on starts beyond stops: of a description's home, and of a scenario for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..names import component_name, joint_of
from ..robot.coordinates import unit_of
from ..robot.mechanism import follower_positions
from ..robot.model import Model, build_model
from ..robot.value import Robot
from ..scenario.value import Scenario


def home_notes(robot: Robot) -> tuple[str, ...]:
    """Return lines about coordinates whose home is beyond a stop; the default home is 0."""
    model = build_model(robot)
    at = dict(zip(model.coordinates, model.home, strict=True))
    at |= follower_positions(robot, at)
    return tuple(f"home: {said}" for said in _beyond(model, at))


def start_notes(scenario: Scenario, robot: Robot) -> tuple[str, ...]:
    """Return lines about coordinates that a scenario puts beyond a stop of the robot; unknown names do not count."""
    if scenario.initial is None:
        return ()
    model = build_model(robot)
    names = {joint_of(model.coordinates[i]): model.coordinates[i] for i in model.principal}
    names |= {name: name for name in model.coordinates}
    at = {names[name]: value for name, value in scenario.initial.q.items() if name in names}
    return tuple(f"initial.q of robot {robot.name}: {said}" for said in _beyond(model, at))


def _beyond(model: Model, at: Mapping[str, float]) -> Iterator[str]:
    """Yield a line on each coordinate outside of its stops; ``at``: coordinates by name, m or rad."""
    for joint in model.robot.joints:
        for kind, coordinate in joint.all_coordinates.items():
            name = component_name(joint.name, kind)
            place, unit = at.get(name), unit_of(name)
            for side, sign in (("lower", -1.0), ("upper", 1.0)):
                stop = coordinate.further.get(f"stops.{side}")
                if place is not None and stop is not None and sign * (place - stop) > 0.0:
                    yield f"{name} = {place:g} {unit} lies beyond its {side} stop at {stop:g} {unit}"
