"""Choices of a functional mock-up unit, by their names."""

from __future__ import annotations

from eomgen.runtime.stepping.options import ADAPTIVE as CHOSEN
from eomgen.runtime.stepping.options import FIXED, ROLLOUTS

VERSIONS = (2, 3)  # of FMI
AUTO = "auto"  # of ADAPTIVE, the one that leads on further for its cost
STEPPERS = {name: number for name, number in CHOSEN.items() if name not in ROLLOUTS}  # those of adaptive_rollout
ADAPTIVE = (AUTO, *STEPPERS)  # methods whose steps the error controls
METHODS = (*ADAPTIVE, *FIXED)  # of co-simulation; but for AUTO those of ``Kernel.rollout``
