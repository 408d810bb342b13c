"""Units of the outputs of kernels that advice about single precision is given on."""

from __future__ import annotations

from collections.abc import Sequence

from ..codegen.kernels.signatures import KERNELS
from ..robot.coordinates import force_unit_of, unit_of
from ..robot.model import Model

_INERTIAS = {0: "kg", 1: "kg m", 2: "kg m^2"}  # of two coordinates, by how many of them are angles


def output_units(model: Model, kernel: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the units of a kernel's outputs; empty texts where they have none, or none that are known here."""
    kinds = [unit_of(name) if name in model.coordinates else "" for name in model.velocities]
    signature = KERNELS[kernel]
    writes = signature.writes
    if writes == "pair":
        return ("J",) * len(names)
    if writes == "constrained" or (signature.solves and writes == "rate_vector"):
        return (*(f"{unit}/s^2" if unit else "" for unit in kinds), *[""] * (len(names) - len(kinds)))
    if writes in ("vector", "rate_vector"):
        return tuple(
            force_unit_of(name) if unit in ("m", "rad") else "" for name, unit in zip(names, kinds, strict=False)
        )
    if signature.symmetric and not signature.needs and all(unit in ("m", "rad") for unit in kinds):
        angles = [int(unit == "rad") for unit in kinds]
        return tuple(_INERTIAS[one + other] for one in angles for other in angles)
    if signature.kind == "frames":
        return tuple("m" if name.endswith("3]") or name.startswith("origin") else "" for name in names)
    return ("",) * len(names)
