"""Choices of an FMU, by their names."""

from __future__ import annotations

from eomgen.kernel.stepping.methods import ADAPTIVE as CHOSEN
from eomgen.runtime.rollouts import FIXED

VERSIONS = (2, 3)  # of FMI
AUTO = "auto"  # of "rosenbrock" and "tsit5" the one that leads on further for its cost
ADAPTIVE = (AUTO, *CHOSEN)  # methods whose steps the error controls
METHODS = (*ADAPTIVE, *FIXED)  # of co-simulation; but for AUTO those of ``Kernel.rollout``
