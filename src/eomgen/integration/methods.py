"""Names of the methods of integration; imports nothing, so that commands and keys of files say them at once."""

from __future__ import annotations

IN_C = ("rosenbrock", "tsit5", "radau")
SCIPY_IMPLICIT = ("Radau", "BDF", "LSODA")
SUNDIALS = ("CVODE", "IDA")
EXPLICIT_IN_PYTHON = ("DOP853", "RK45", "rk4")
EXPLICIT = ("tsit5", *EXPLICIT_IN_PYTHON)
METHODS = ("auto", *IN_C, *SCIPY_IMPLICIT, *SUNDIALS, *EXPLICIT_IN_PYTHON)
