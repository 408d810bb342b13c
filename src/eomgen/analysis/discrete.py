"""Linear systems in discrete time, with inputs that are constant between samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..limits import LARGEST, is_usable
from ..names import show
from ..optional import optional_import
from ..shown import Shown


@dataclass(frozen=True, kw_only=True)
class DiscreteStateSpace(Shown):
    """x[k+1] = A x[k] + B w[k], y[k] = C x[k] + D w[k] at times k dt, with inputs constant between them.

    Attributes:
        robot: the robot's name.
        A, B, C, D: (states, states), (states, inputs), (outputs, states), (outputs, inputs); SI units, rad.
        dt: s.
        states, inputs, outputs: names, as of the system in continuous time.
        kind: of the outputs: displacement, velocity or acceleration.
    """

    robot: str
    A: Array
    B: Array
    C: Array
    D: Array
    dt: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    kind: str

    @property
    def matrices(self) -> tuple[Array, Array, Array, Array, float]:
        """(A, B, C, D, dt), as scipy.signal.dlti(*...) and control.ss(*...) take them."""
        return self.A, self.B, self.C, self.D, self.dt

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "robot": self.robot,
            **{name: getattr(self, name).tolist() for name in "ABCD"},
            "dt": self.dt,
            **{name: list(getattr(self, name)) for name in ("states", "inputs", "outputs")},
            "kind": self.kind,
        }

    def lines(self) -> list[str]:
        """Return sizes, names and the largest eigenvalue, for people."""
        lines = [
            f"{self.robot}: {len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs,"
            f" every {self.dt:g} s",
            f"  inputs: {', '.join(self.inputs)}",
            f"  outputs: {', '.join(self.outputs)} ({self.kind})",
        ]
        if self.states:
            lines.append(f"  largest eigenvalue: {np.abs(np.linalg.eigvals(self.A)).max():.6g} in magnitude")
        return lines


def zero_order_hold(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    """Return A and B in discrete time, exactly: the blocks of exp([[A, B], [0, 0]] dt).

    Raises:
        InputError: dt is not a time above 0, a number is out of range, or SciPy is not installed.
    """
    with optional_import("SciPy", "a system in discrete time needs"):
        from scipy.linalg import expm
    if not (is_usable(dt) and dt > 0.0):
        raise InputError(f"dt: {show(dt)} s; allowed: a time above 0, up to {LARGEST:g}")
    m, inputs = B.shape
    whole = np.zeros((m + inputs, m + inputs))
    whole[:m, :m], whole[:m, m:] = A, B
    with np.errstate(all="ignore"):
        held = np.asarray(expm(whole * float(dt)))
    if not np.isfinite(held).all():
        raise InputError(f"dt: {show(dt)} s; the system grows beyond all numbers within it; allowed: a shorter time")
    return held[:m, :m], held[:m, m:]
