"""Reading of [[beams]], which become links and joints of the draft."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from ...errors import DescriptionError
from ...forms.keys import Whole
from ...forms.tables import Table
from ...limits import MOST_ENTRIES
from ...names import listed, show
from ...robot.sections import POISSON, SHAPES, Section
from ...robot.value import BASE, COORDINATES, Beam, Placement, Robot
from ..draft import Draft, ordered_joints
from ..forces import read_placement

_OF_SECTION = ("A", "Iy", "Iz", "J", "shear")


def add_beam(name: str, entry: Table, draft: Draft) -> None:
    """Read one entry of [[beams]], and add the beam's links and joints to the draft.

    Raises:
        DescriptionError: a key is missing or wrong, keys do not go together, or its links and joints have the names of
            others.
    """
    beam = read_beam(name, entry)
    count = len(draft.links) + len(beam.link_names)
    if count > MOST_ENTRIES:
        message = f"got {beam.segments}, and with its links there are {count}; allowed: up to {MOST_ENTRIES}"
        entry.fail(message, "segments")
    _check_names("link", beam.link_names, {BASE, *draft.links}, entry)
    _check_names("joint", beam.joint_names, draft.joints, entry)
    draft.links |= {link.name: link for link in beam.links()}
    draft.joints |= {joint.name: joint for joint in beam.joints()}
    draft.beams[name] = beam


def read_beam(name: str, entry: Table) -> Beam:
    """Read one entry of [[beams]], of the keys ``BEAM``; errors as ``add_beam``."""
    entry.require()
    if entry.text("parent") == entry.text("child"):
        entry.fail(f"got {show(entry.text('child'))}, the parent; allowed: two different links", "child")
    numbers = {key: entry.number(key) or 0.0 for key in ("length", "E", "G", "density")}  # all of them are needed
    section, placement = read_section(entry, numbers["E"], numbers["G"]), entry.table("placement")
    beam = Beam(
        name,
        entry.text("parent") or "",
        entry.text("child") or "",
        segments=entry.value("segments", Whole),
        A=section.A,
        Iy=section.Iy,
        Iz=section.Iz,
        J=section.J,
        shear=(section.shear[0], section.shear[1]),
        axis=entry.choice("axis") or "x",
        placement=Placement() if placement is None else read_placement(placement),
        damping=_damping(entry),
        rigid=tuple(entry.strings("rigid")),
        **numbers,
    )
    conflict = beam.conflict()
    if conflict is not None:
        entry.fail(conflict[1], conflict[0])
    return beam


def check_beam_ends(draft: Draft) -> None:
    """Raise DescriptionError if a beam begins on no link, or carries one that is not there or that a joint carries."""
    for name, beam in draft.beams.items():
        where, tip = f"beams.{name}", beam.joint_names[-1]
        draft.check_link(beam.parent, f"{where}.parent")
        draft.check_link(beam.child, f"{where}.child")
        if beam.child == draft.base:
            draft.fail(f"{where}.child", f"{show(beam.child)} is the base, which nothing carries; allowed: a link")
        others = [x.name for x in draft.joints.values() if x.child == beam.child and x.name != tip]
        if others:
            message = f"link {show(beam.child)} is the child of joint {show(others[0])}; allowed: one parent per link"
            draft.fail(f"{where}.child", message)


def with_changed_beams(robot: Robot, before: Sequence[Beam]) -> Robot:
    """Return the robot with links and joints anew of those beams that are not as they were before.

    Whatever of their own had been changed in these links and joints is that of the beam again.

    Args:
        robot: its beams are the changed ones, its links and joints those of before.
        before: its beams as they were, in their order.

    Raises:
        DescriptionError: links and joints have names of others, or form no tree any more.
    """
    links = {link.name: link for link in robot.links}
    joints = {joint.name: joint for joint in robot.joints}
    for old, new in zip(before, robot.beams, strict=True):
        if old != new:
            others = links.keys() - set(old.link_names), joints.keys() - set(old.joint_names)
            taken = {*others[0].intersection(new.link_names), *others[1].intersection(new.joint_names)}
            if taken:
                message = f"links or joints have the names {listed(sorted(taken))}; allowed: a beam with other ones"
                raise DescriptionError(message, where=f"beams.{new.name}", source=robot.source)
            links = _in_place(links, old.link_names, {link.name: link for link in new.links()})
            joints = _in_place(joints, old.joint_names, {joint.name: joint for joint in new.joints()})
    ordered = ordered_joints(Draft(robot.source, robot.name, robot.base, links=links, joints=joints))
    return replace(robot, joints=tuple(ordered), links=tuple(links[joint.child] for joint in ordered))


_Item = TypeVar("_Item")


def _in_place(items: Mapping[str, _Item], old: Sequence[str], new: Mapping[str, _Item]) -> dict[str, _Item]:
    """Return items by name with new ones where the first of the old ones is, without the others of these."""
    result: dict[str, _Item] = {}
    for name, item in items.items():
        if name == old[0]:
            result |= new
        elif name not in old:
            result[name] = item
    return result


def _check_names(what: str, names: tuple[str, ...], taken: Container[str], entry: Table) -> None:
    """Refuse names of the beam's that others have."""
    same = [name for name in names if name in taken]
    if same:
        message = f"the beam's {what} would have the name of another: {listed(same)}; allowed: another name of either"
        entry.fail(message, "name")


def read_section(entry: Table, E: float, G: float) -> Section:
    """Return the numbers of the section: those of its table, and in their place those that the entry has itself."""
    table = entry.table("section")
    numbers = {key: entry.number(key) for key in _OF_SECTION[:-1] if key in entry}
    shear = entry.numbers("shear")
    if table is None:
        for key in _OF_SECTION:
            entry.require_one(key, f"{', '.join(_OF_SECTION)}, or a section")
        A, Iy, Iz, J = (numbers[key] or 0.0 for key in _OF_SECTION[:-1])
        return Section(A, Iy, Iz, J, shear or ())
    if len(table.values) != 1:
        table.fail(f"it has {len(table.values)} keys; allowed: one of {', '.join(SHAPES)}")
    (kind,) = table.values
    shape = SHAPES[kind]
    number = table.number(kind) if len(shape.names) == 1 else None
    sizes = (number,) if number is not None else table.numbers(kind) or ()
    if not shape.fits(sizes):
        table.fail(f"got {show(table.values[kind])}; allowed: [{', '.join(shape.names)}], {shape.rule}", kind)
    nu = E / (2.0 * G) - 1.0
    if shear is None and not POISSON[0] < nu <= POISSON[1]:
        message = f"Poisson's ratio E / (2 G) - 1 is {nu:.6g}, so that no shear coefficients follow from the section"
        entry.fail(f"{message}; allowed: above {POISSON[0]:g}, up to {POISSON[1]:g}, or shear = [ky, kz]", "G")
    made = shape.section(sizes, nu if shear is None else None)
    values = {key: getattr(made, key) for key in _OF_SECTION} | numbers
    form = None if numbers else (kind, tuple(sizes))
    return Section(values["A"], values["Iy"], values["Iz"], values["J"], shear or made.shear, form)


def _damping(entry: Table) -> tuple[float, ...]:
    """Return damping by stiffness of each coordinate of a segment, s."""
    value = entry.value("damping") if "damping" in entry else 0.0
    if isinstance(value, Table):
        ratio, loss, hertz = (value.number(key) for key in ("ratio", "loss_factor", "at_hz"))
        if (ratio is None) == (loss is None):
            value.fail(f"{'none is' if ratio is None else 'both are'} given; allowed: one of ratio, loss_factor")
        factor = loss if ratio is None else 2.0 * ratio
        assert factor is not None
        assert hertz is not None
        value = factor / (2.0 * math.pi * hertz)
    return (value,) * len(COORDINATES) if isinstance(value, float) else tuple(value)
