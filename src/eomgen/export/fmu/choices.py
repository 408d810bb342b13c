"""Choices of a functional mock-up unit, by their names."""

from __future__ import annotations

VERSIONS = (2, 3)  # of FMI
METHODS = ("rk4", "implicit")  # of ``Kernel.rollout``
