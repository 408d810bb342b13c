"""Names of the methods of integration, which commands and keys of files say without importing more of eomgen."""

from __future__ import annotations

from typing import Literal, get_args

IN_C = ("rosenbrock", "tsit5", "radau")
SCIPY_IMPLICIT = ("Radau", "BDF", "LSODA")
SUNDIALS = ("CVODE", "IDA")
EXPLICIT_IN_PYTHON = ("DOP853", "RK45", "rk4")
EXPLICIT = ("tsit5", *EXPLICIT_IN_PYTHON)
Method = Literal[
    "auto", "rosenbrock", "tsit5", "radau", "Radau", "BDF", "LSODA", "CVODE", "IDA", "DOP853", "RK45", "rk4"
]
METHODS: tuple[str, ...] = get_args(Method)
