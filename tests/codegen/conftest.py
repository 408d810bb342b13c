"""Kernels for tests of the generator, which compare arrays of the C."""

from __future__ import annotations

import pytest

import eomgen
from eomgen.robot.value import Robot
from tests.support.builds import Build


@pytest.fixture(scope="module")
def built(built: Build) -> Build:
    """As ``built`` of all tests; internal states stand behind coordinates, as in the C."""

    def build(robot: Robot, *kernels: str, **options: object) -> eomgen.Kernel:
        return built(robot, *kernels, **options).augmented

    return build
