"""Limits that compensated paths keep: they take from corrections what leads beyond, without a kink."""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Mask
from ...motion.splines import Spline
from .setting import Setting

KNEE = 0.8  # of the room to a limit, up to which a correction stays what it is
HELD = 1e-3  # of the greatest correction: what is taken from it counts from there on


def within_limits(setting: Setting, correction: Array) -> Array:
    """Return as much of corrections, (T, m), as lets the path keep its limits of place and rate.

    Where the reference without them is beyond a limit, it gets no further beyond it.
    """
    bounded = np.empty_like(correction)
    for j, (low, high) in enumerate(setting.limits):
        place, wish = setting.original[:, j], correction[:, j]
        room = np.where(wish > 0.0, np.maximum(high - place, 0.0), np.maximum(place - low, 0.0))
        bounded[:, j] = _softly(wish, room)
    return bounded * _shares(setting, bounded)


def _softly(wish: Array, room: Array) -> Array:
    """Return numbers held within +- room, with continuous second derivatives."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        share = np.where(room > 0.0, np.abs(wish) / room, np.inf)
        bent = KNEE + (1.0 - KNEE) * np.tanh((share - KNEE) / (1.0 - KNEE))
        return np.where(share <= KNEE, wish, np.where(room > 0.0, np.sign(wish) * bent * room, 0.0))


def _shares(setting: Setting, correction: Array) -> Array:
    """Return shares of all of a coordinate's correction, (m,), with which its rate keeps its limit."""
    shares = np.ones(len(setting.rates))
    if np.isinf(setting.rates).all():
        return shares
    times = setting.before.trajectory.t
    before = Spline(setting.t, setting.original, at_rest=False).at(times)[1]
    change = Spline(setting.t, correction, at_rest=False).at(times)[1]
    allowed = np.maximum(setting.rates, np.abs(before))
    over = np.abs(before + change) > allowed
    room = np.where(change > 0.0, allowed - before, allowed + before)
    shares[:] = np.min(np.where(over, room / np.where(over, np.abs(change), 1.0), 1.0), axis=0)
    return shares


def held_back(wanted: Array, taken: Array) -> Mask:
    """Mark where limits took something from corrections, (T, m)."""
    size = HELD * np.maximum(np.abs(wanted).max(axis=0, initial=0.0), 1e-12)
    return np.asarray(np.abs(wanted - taken) > size)
