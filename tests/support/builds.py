"""Kernels that tests build."""

from __future__ import annotations

from collections.abc import Callable

import eomgen

Build = Callable[..., eomgen.Kernel]
