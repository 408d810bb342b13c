"""Choices of a functional mock-up unit, by their names."""

from __future__ import annotations

VERSIONS = (2, 3)  # of FMI
AUTO = "auto"  # of ADAPTIVE, the one that leads on further for its cost
ADAPTIVE = (AUTO, "rosenbrock", "tsit5")  # methods whose steps the error controls
METHODS = (*ADAPTIVE, "rk4", "implicit")  # of co-simulation; but for AUTO those of ``Kernel.rollout``
