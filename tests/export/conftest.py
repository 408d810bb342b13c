"""Functional mock-up units that tests of a module share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from eomgen.robot.record import robot_hash
from eomgen.robot.value import Robot
from tests.support.builds import Build

if TYPE_CHECKING:
    from tests.support.fmu_units import Unit


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory, built: Build) -> Callable[..., Unit]:
    """``exported(robot, version, options)``: a unit that is compiled once, without optimisation; by rk4 by default."""
    from tests.support.fmu_units import Unit

    known: dict[object, Unit] = {}

    def export(robot: Robot, version: int = 3, **options: object) -> Unit:
        key = (robot_hash(robot), version, *sorted(options.items()))
        if key not in known:
            known[key] = Unit(robot, tmp_path_factory.mktemp("unit"), version, built, **options)
        return known[key]

    return export
