"""Material of beams out of the stiffness and damping of their modes: notes of a fit, in the description's words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...names import parameter_name
from ...robot.coordinates import LINKS
from ...robot.value import Link, Robot
from .result import KEYS, Estimate

FILTERED = 2e-4  # of a value, which filters of a motion bend and standard errors do not hold
APART = 4.0  # standard errors of modes from what they have in common, from which on they contradict one another


def beam_notes(robot: Robot, estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield what fitted modes of beams say of E, G and modal damping.

    Stiffness of modes is in proportion to E where G is, that of twist to G; what a beam's modes have in common is the
    mean of theirs, weighted by their standard errors.

    Args:
        robot: whose links are beams.
        estimates: by names of run-time parameters.
    """
    for link in robot.links:
        if link.beam is None or link.modes is None:
            continue
        own = [
            [estimates.get(parameter_name(LINKS, link.name, f"modes.{k + 1}", key)) for key in KEYS]
            for k in range(link.modes.count)
        ]
        counts = link.beam.modes.counts
        kinds = [direction for direction, count in counts.items() for _ in range(count)]
        for key, twists in (("E", False), ("G", True)):
            found = [x for (x, _), kind in zip(own, kinds, strict=True) if x and (kind == "torsion") is twists]
            ratios = [(x.value / x.described, x.standard_error / x.described) for x in found if x.described > 0.0]
            text = _common(ratios, getattr(link.beam, key), f"links.{link.name}.beam.{key}", " N/m^2")
            if text:
                others = "" if twists else ", with G in proportion"
                yield f"{text}, by the stiffness of {_modes(ratios)}{others}"
        yield from _damping(link, own)


def _damping(link: Link, own: Sequence[Sequence[Estimate | None]]) -> Iterator[str]:
    """Yield what modes say of modal damping: D_kk = 2 zeta sqrt(K_kk m_kk)."""
    assert link.modes is not None
    shares = []
    for k, (stiffness, damping) in enumerate(own):
        K = stiffness.value if stiffness is not None else link.modes.K[k][k]
        if damping is not None and K > 0.0:
            critical = 2.0 * math.sqrt(K * link.modes.masses[k][k])
            shares.append((damping.value / critical, damping.standard_error / critical))
    text = _common(shares, 1.0, f"links.{link.name}.modal_damping", "")
    if text:
        yield f"{text}, by the damping of {_modes(shares)}"


def _modes(values: Sequence[object]) -> str:
    return f"{len(values)} modes" if len(values) > 1 else "1 mode"


def _common(values: Sequence[tuple[float, float]], size: float, name: str, unit: str) -> str:
    """Say what values with standard errors have in common, times a size; "" where there are none."""
    if not values:
        return ""
    x, errors = np.array(values).T
    errors = np.maximum(errors, 1e-12 * np.maximum(np.abs(x), 1e-300))
    weights = 1.0 / errors**2
    mean, error = float(weights @ x / weights.sum()), float(1.0 / math.sqrt(weights.sum()))
    said = f"{name} = {size * mean:.6g} +- {size * error:.2g}{unit}"
    worst = float((np.abs(x - mean) / np.hypot(errors, FILTERED * mean)).max())
    if worst > APART:
        return f"{said} (modes contradict one another: {', '.join(f'{size * one:.4g}' for one in x.tolist())})"
    return said
