"""Deflection and stiffness of a frame as a page, with stress resultants of beams."""

from __future__ import annotations

from collections.abc import Iterator

from ...analysis.statics import Deflection
from ...bending.beams.resultants import COMPONENTS, StressResultants
from ...robot.coordinates import MOTIONS, unit_of
from ..analysis import plot_stress_resultants
from ..report import Report, Table, drawn, sorted_notes
from .tables import number, table


def deflection_page(deflection: Deflection) -> Report:
    """A page about a frame under load: its deflection, stiffness or compliance, and stress resultants of beams."""
    figures = []
    if deflection.beams:
        text = "Forces and moments on the part before a section, in the section's axes, and the greatest normal stress."
        figures.append(("stress_resultants", text, plot_stress_resultants))
    warnings, notes = sorted_notes(deflection.notes)
    return Report(
        title=f"{deflection.robot}: deflection and stiffness of {deflection.frame}",
        summary=(
            "static equilibrium beside the rigid robot, base frame",
            f"compliance of rank {deflection.rank} of 6",
        ),
        warnings=warnings,
        notes=notes,
        figures=drawn(deflection, figures),
        tables=tuple(_tables(deflection)),
    )


def _tables(deflection: Deflection) -> Iterator[Table]:
    units = ("m", "m", "m", "rad", "rad", "rad")
    rows = zip(MOTIONS, deflection.deflection, deflection.by_loads, units, strict=True)
    moved = [(name, number(whole), number(part), unit) for name, whole, part, unit in rows]
    yield from table("Deflection", ("", "whole", "of it by loads", "unit"), moved)
    matrix, title = deflection.compliance, "Compliance, m, rad per N, N m"
    if deflection.stiffness is not None:
        matrix, title = deflection.stiffness, "Stiffness, N, N m per m, rad"
    entries = [(name, *(number(x, 1.0, 4) for x in row)) for name, row in zip(MOTIONS, matrix, strict=True)]
    yield from table(title, ("", *MOTIONS), entries)
    for beam in deflection.beams:
        yield _beam_table(beam)
    where = zip(deflection.coordinates, deflection.q, deflection.u, strict=True)
    held = [(name, number(q), unit_of(name), number(u)) for name, q, u in where]
    yield from table("Static equilibrium", ("coordinate", "value", "unit", "held by, N or N m"), held)


def _beam_table(beam: StressResultants) -> Table:
    """Return the table of a beam's sections."""
    head = ["x, m", *(f"{name}, {'N' if k < 3 else 'N m'}" for k, name in enumerate(COMPONENTS))]
    rows = [[number(x), *(number(value) for value in row)] for x, row in zip(beam.x, beam.resultants, strict=True)]
    if beam.stress is not None:
        head.append("stress, MPa")
        rows = [[*row, number(stress, 1e-6)] for row, stress in zip(rows, beam.stress, strict=True)]
    return Table(f"Stress resultants of {beam.link}", tuple(head), tuple(map(tuple, rows)))
