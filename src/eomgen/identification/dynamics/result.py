"""Results of identification: base parameters with their deviations, what they leave of each drive, and a robot."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ...arrays import Array, Mask
from ...description.recorded import robot_from_record
from ...errors import InputError
from ...names import listed
from ...results.contents import Contents
from ...results.kinds import Kind, Saved, declare
from ...results.stored import Stored
from ...robot.coordinates import force_unit_of
from ...robot.record import record_of
from ...robot.value import Robot
from ...shown import Plotting, Shown
from ..estimating import SOLVED
from ..identifiable import BaseParameters
from .as_toml import write_toml

OVERFITTED, NOTICED = 3.0, 0.1  # times a residual that was fitted; of the drive
REPRODUCED, SMALL = 1.5, 1e-4  # times a residual that was fitted, or of the drive: what the robot may leave


@dataclass(frozen=True)
class Residuals:
    """Residuals of a drive, rms, N or N m: of samples that parameters were fitted to, and of blocks held out.

    ``robot`` is the residual of the physically consistent robot in the samples that parameters were fitted to.
    ``drive`` is the rms of the measured drive itself over the whole record, or, where there is none, of the forces in
    its row that are known; ``samples`` how many count.
    """

    fitted: float
    held_out: float
    drive: float
    samples: int
    robot: float = 0.0

    @property
    def is_reproduced(self) -> bool:
        """Whether the robot leaves at most REPRODUCED times what was fitted, or SMALL of the drive."""
        return self.robot <= max(REPRODUCED * self.fitted, SMALL * self.drive)

    @property
    def relative(self) -> tuple[float, float]:
        """Both, fitted and held out, over the drive's rms."""
        return self.fitted / max(self.drive, 1e-300), self.held_out / max(self.drive, 1e-300)


@dataclass(frozen=True)
class Further:
    """A parameter that forces are not linear in: its value and standard deviation, and their unit."""

    value: float
    deviation: float
    unit: str


@dataclass(frozen=True)
class IdentifyResult(Plotting, Shown, Saved, plot="plot_identification"):
    """Base parameters with their standard deviations, and what they leave of each drive.

    Attributes:
        robot: the description with physically consistent links of these base parameters, near to the described ones.
        base: the combinations that the motion shows, with their formulas.
        base_values: of these, (b,), SI units.
        deviations: standard deviations, (b,), the jackknife's over blocks of time.
        described: the description's values of the same combinations, (b,).
        parameters: of the links, rotors and drives of ``robot`` by name, kg, kg m, kg m^2, N m s, N m and their like.
        residuals: by the names of the coordinates; of those that others follow in a rigid coupling all together.
        width: of the filter, s.
        warnings, notes: lines about what is doubtful, and about the method.
        of_robot: values of the combinations that ``robot`` has, (b,); none in files of older versions.
        status: "converged", or what has not.
        unexcited: combinations that the motion shows less well than the description.
        further: parameters that forces are not linear in, by name: "delay", "joint1.gamma.gain" and their like.
        t: times behind the filters, (T,), s.
        drives, fitted: (T, r), measured drives and what the parameters make of them, in the order of ``residuals``.
        kept: whether a sample counts, (T, r): not where a filter sees a drive stand still.
    """

    robot: Robot
    base: BaseParameters
    base_values: Annotated[Array, Stored(("b",), "SI")]
    deviations: Annotated[Array, Stored(("b",), "SI")]
    described: Annotated[Array, Stored(("b",), "SI")]
    parameters: dict[str, float]
    residuals: dict[str, Residuals]
    width: float
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    of_robot: Annotated[Array, Stored(("R",), "SI", otherwise=np.zeros(0))] = field(default_factory=lambda: np.zeros(0))
    status: Annotated[str, Stored(otherwise=SOLVED)] = SOLVED
    unexcited: Annotated[tuple[str, ...], Stored(otherwise=())] = ()
    further: dict[str, Further] = field(default_factory=dict)
    t: Annotated[Array, Stored(("T",), "s")] = field(default_factory=lambda: np.zeros(0))
    drives: Annotated[Array, Stored(("T", "r"), "N, N m")] = field(default_factory=lambda: np.zeros((0, 0)))
    fitted: Annotated[Array, Stored(("T", "r"), "N, N m")] = field(default_factory=lambda: np.zeros((0, 0)))
    kept: Annotated[Mask, Stored(("T", "r"), of=bool)] = field(default_factory=lambda: np.zeros((0, 0), dtype=np.bool_))

    @property
    def base_names(self) -> tuple[str, ...]:
        """Formulas of the combinations, such as "link2.mx + 0.4318 link3.m"."""
        return self.base.names

    @property
    def contradicted(self) -> dict[str, Residuals]:
        """Residuals that blocks held out contradict: more than the drive itself, or many times what was fitted."""
        return {
            name: left
            for name, left in self.residuals.items()
            if left.held_out > left.drive or (left.held_out > OVERFITTED * left.fitted and left.relative[1] > NOTICED)
        }

    def _refuse(self) -> None:
        """Raise InputError where the fit is no robot that explains the data."""
        reasons = [] if self.status == SOLVED else [f"not converged: {self.status}"]
        for name, left in self.contradicted.items():
            fitted, held_out = left.relative
            reasons.append(
                f"of {name}'s drive {100 * held_out:.3g} % stay unexplained in blocks of time that were held out,"
                f" {100 * fitted:.3g} % in those fitted to"
            )
        for name, left in self.residuals.items():
            if not left.is_reproduced:
                reasons.append(
                    f"the robot leaves {left.robot:.3g} {force_unit_of(name)} of {name}'s drive, where the base"
                    f" parameters leave {left.fitted:.3g}"
                )
        if not reasons:
            return
        open_ones = f"; not excited by the motion: {listed(self.unexcited)}" if self.unexcited else ""
        raise InputError(
            f"{self.robot.name}: nothing is written: {'; '.join(reasons)}{open_ones}; allowed: motions that excite all"
            " parameters, longer ones, fewer terms, a larger --spread, or --force (force=True)"
        )

    def to_toml(self, path: Path | str, *, force: bool = False) -> Path:
        """Write the description with the links, rotors and friction of ``robot``, and return the path.

        Base parameters with their standard deviations stand above it as comments.

        Args:
            path: of the file.
            force: whether to write a robot that does not explain the data, or of a fit that did not converge.

        Raises:
            InputError: the robot was read from no TOML or URDF, another ending, the file cannot be written, the fit did
                not converge, the robot leaves more of the drives than base parameters do, or blocks of time that were
                held out contradict it.
        """
        if not force:
            self._refuse()
        lines = [
            f"# {name} = {value:.9g} +- {deviation:.2g} {unit_of_parameter(name)}"
            for name, value, deviation in zip(self.base_names, self.base_values, self.deviations, strict=True)
        ]
        lines += [f"# {name} = {x.value:.9g} +- {x.deviation:.2g} {x.unit}" for name, x in self.further.items()]
        return write_toml(self.robot, self.parameters, lines, Path(path))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            **self.base.as_dict(),
            "values": dict(zip(self.base_names, self.base_values.tolist(), strict=True)),
            "deviations": dict(zip(self.base_names, self.deviations.tolist(), strict=True)),
            "described": dict(zip(self.base_names, self.described.tolist(), strict=True)),
            "of_robot": dict(zip(self.base_names, self.of_robot.tolist(), strict=False)),
            "status": self.status,
            "unexcited": list(self.unexcited),
            "further": {name: vars(entry) for name, entry in self.further.items()},
            "parameters": self.parameters,
            "residuals": {
                name: {**vars(entry), "relative": dict(zip(("fitted", "held_out"), entry.relative, strict=True))}
                for name, entry in self.residuals.items()
            },
            "width": self.width,
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return tables for people."""
        lines = [f"{self.base.robot}: {len(self.base)} base parameters by least squares, {self.status}", ""]
        lines.append(f"{'value':>12}{'std. dev.':>12}{'described':>12}{'robot':>12}  parameter")
        robots = [f"{x:.5g}" for x in self.of_robot.tolist()] or [""] * len(self.base)
        columns = (self.base_values, self.deviations, self.described)
        for name, robot, *numbers in zip(self.base_names, robots, *columns, strict=True):
            value, deviation, described = (float(x) for x in numbers)
            lines.append(f"{value:>12.5g}{deviation:>12.2g}{described:>12.5g}{robot:>12}  {name}")
        for name, further in self.further.items():
            lines.append(f"{further.value:>12.5g}{further.deviation:>12.2g}{'':>24}  {name}, {further.unit}")
        lines += ["", f"{'residual, rms':<28}{'fitted':>12}{'held out':>12}{'robot':>12}{'of the drive':>24}"]
        for name, left in self.residuals.items():
            label, (fitted, held_out) = f"{name} [{force_unit_of(name)}]", left.relative
            share = f"{100 * fitted:.3g} %, {100 * held_out:.3g} %"
            lines.append(f"{label:<28}{left.fitted:>12.4g}{left.held_out:>12.4g}{left.robot:>12.4g}{share:>24}")
        return lines + ["", *(f"warning: {x}" for x in self.warnings), *(f"note: {x}" for x in self.notes)]


def _record(result: IdentifyResult) -> dict[str, Any]:
    base = result.base
    record = record_of(result.robot)
    return {"description": record, "base": base.texts(), "chosen": base.chosen, "matrix": base.matrix}


def _rebuild(file: Contents) -> dict[str, Any]:
    matrix = file.array("matrix", _MATRIX)
    _MATRIX.check(matrix, {}, f"{file.path}: array matrix")
    base = BaseParameters.from_texts(file.table("base"), file.array("chosen", Stored(("b",), of=int)), matrix)
    return {"robot": robot_from_record(file.plain.get("description", {}), file.path), "base": base}


def _sizes(result: IdentifyResult) -> dict[str, int]:
    many = len(result.base)
    return {"b": many, "T": len(result.t), "r": len(result.residuals), "R": many if len(result.of_robot) else 0}


_MATRIX = Stored(("b", "p"), "SI")
load_identification = declare(
    Kind(
        "identification",
        IdentifyResult,
        rebuilt=("robot", "base"),
        record=_record,
        rebuild=_rebuild,
        sizes=_sizes,
    )
)
"""Read the result that ``IdentifyResult.save`` wrote; InputError says what in the file is wrong."""


_UNITS = {"m": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m", "inertia": "kg m^2"}


def unit_of_parameter(formula: str) -> str:
    """Return the unit of a combination, which is that of the parameter that begins it."""
    name = formula.split(" ")[0]
    owner, _, key = name.rpartition(".")
    if key in _UNITS or key.startswith("i"):
        return _UNITS.get(key, "kg m^2")
    force = force_unit_of(owner)
    is_linear = force == "N"
    if key == "armature":
        return "kg" if is_linear else "kg m^2"
    if key in ("viscous", "damping"):
        return f"{force} s/m" if is_linear else f"{force} s/rad"
    if key == "stiffness":
        return f"{force}/m" if is_linear else f"{force}/rad"
    return force
