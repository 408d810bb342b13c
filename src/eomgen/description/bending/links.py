"""Reading of links that bend, and of the nodes of these that joints, frames and forces stand on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import DescriptionError, InputError
from ...forms.keys import ByName, Whole
from ...forms.tables import Table
from ...limits import LARGEST
from ...names import listed, nearest, show
from ...robot.value import (
    INERTIA_KEYS,
    ROOT,
    BeamModes,
    Link,
    LinkBeam,
    LinkModes,
    Placement,
    Robot,
    made_of,
    node_link,
)
from ...robot.value.link_beam import OF_SECTION
from ..draft import Draft
from ..forces import read_placement
from .beams import read_section
from .sliding import replaced, with_changed_shapes

if TYPE_CHECKING:
    from ...bending.link_files import HowToTake

_SAME_BODY = 1e-6  # that given masses may be off those of the modes, by the link's size
_BODY = ("mass", "com", "inertia")


def bending_link(name: str, entry: Table, folder: Path | None, draft: Draft) -> Link | None:
    """Return the link of an entry that bends, with mass, com and inertia of its modes; None of a rigid one.

    Args:
        name: of the link.
        entry: of the keys ``LINK``.
        folder: where files of modes are looked for; None where there is none.
        draft: is told of modes of a free link.

    Raises:
        DescriptionError: a key is missing or wrong, keys do not go together, or the file cannot be taken.
    """
    table, damping = entry.table("beam"), entry.number("modal_damping")
    if table is not None and "modes" in entry:
        entry.fail("both beam and modes are set; allowed: one of them", "modes")
    if table is not None:
        return link_of_beam(name, _beam(table), damping)
    if "modes" in entry:
        return _link_of_file(name, entry, folder, damping, draft)
    if damping is not None:
        entry.fail("the link has no modes; allowed: with beam or modes", "modal_damping")
    return None


def link_of_beam(name: str, beam: LinkBeam, damping: float | None) -> Link:
    """Return the link that a beam is."""
    from ...bending.beam import beam_inertia, beam_modes  # NumPy, which robots without such links are read without
    from ...bending.constants import body_of

    return Link(name, *body_of(beam_inertia(beam)), beam_modes(beam, damping or 0.0), beam, damping)


def check_body(entry: Table, link: Link) -> None:
    """Refuse mass, centre of mass or inertia of an entry that are not those of the link's modes."""
    size = math.sqrt(max(link.inertia[:3]) / link.mass + sum(x * x for x in link.com))
    sizes = dict(zip(_BODY, (link.mass, size, link.mass * size**2), strict=True))
    table = entry.table("inertia")
    given: dict[str, Sequence[float] | None] = {
        "mass": None if (mass := entry.number("mass")) is None else (mass,),
        "com": entry.vector("com"),
        "inertia": None if table is None else [table.number(key) or 0.0 for key in INERTIA_KEYS],
    }
    for key, values in given.items():
        own = (link.mass,) if key == "mass" else getattr(link, key)
        for i, (value, wanted) in enumerate(zip(values or (), own, strict=False)):
            if abs(value - wanted) > _SAME_BODY * sizes[key]:
                part = {"mass": key, "com": f"com[{i}]", "inertia": f"inertia.{INERTIA_KEYS[i]}"}[key]
                got = f"got {value:g}, and that of its modes is {wanted:.9g}"
                entry.fail(f"{got}; allowed: the same, or no {key}", part)


def on_node(entry: Table, key: str, link: str, node: str | None, draft: Draft) -> str:
    """Return the link that a node of a link is made of, or the link itself where no node is asked for, or the root.

    Args:
        entry: what stands there, for messages.
        key: of the node.
        link: name, which may be wrong: that is looked at when all links are known.
        node: name; None for none.
        draft: whose links are read.
    """
    if node is None or node == ROOT or (link not in draft.links and link not in (draft.base, "base")):
        return link
    modes = draft.links[link].modes if link in draft.links else None
    if modes is None:
        entry.fail(f"got {show(node)}, and {show(link)} does not bend; allowed: {ROOT}, or a link that bends", key)
    known = (ROOT, *(x.name for x in modes.nodes))
    if node not in known:
        entry.fail(f"{show(link)} has no node {show(node)}{nearest(node, known)}; allowed: {', '.join(known)}", key)
    return node_link(link, node)


def on_nodes(entry: Table, links: tuple[str, str], draft: Draft) -> tuple[str, str]:
    """Return the two links of a loop or force element, those of their nodes where it stands on such."""
    nodes = entry.strings("nodes") or [ROOT, ROOT]
    first, second = (on_node(entry, f"nodes[{i}]", links[i], nodes[i], draft) for i in range(2))
    return first, second


def add_nodes(draft: Draft) -> None:
    """Add the links, joints and couplings that nodes are made of.

    Raises:
        DescriptionError: others have their names.
    """
    for link in list(draft.links.values()):
        for made, joint, couplings in made_of(link):
            groups = ((draft.links, (made,)), (draft.joints, (joint,)), (draft.couplings, couplings))
            taken = [x.name for group, items in groups for x in items if x.name in group or x.name == draft.base]
            if taken:
                message = f"its nodes are links, joints and couplings of the names {listed(taken)}, which are taken"
                draft.fail(f"links.{link.name}", f"{message}; allowed: another name of either")
            draft.links[made.name] = made
            draft.joints[joint.name] = joint
            draft.couplings |= {x.name: x for x in couplings}


def check_carriers(draft: Draft) -> None:
    """Refuse a link that bends behind a rigid joint, and modes of a free link behind a joint that is not free."""
    for joint in draft.joints.values():
        link = draft.links.get(joint.child)
        if link is not None and link.modes is not None and not joint.coordinates:
            message = f"it bends, and joint {show(joint.name)} is rigid"
            draft.fail(f"links.{link.name}", f"{message}; allowed: behind a joint that moves")
        if joint.child in draft.free_modes and not joint.is_free:
            message = f"these are modes of a free link, and joint {show(joint.name)} is {joint.type}"
            draft.fail(
                f"links.{joint.child}.modes",
                f"{message}; allowed: behind a free joint, or modes of the link that is clamped at its root",
            )


def with_changed_bending(robot: Robot, before: Robot) -> Robot:
    """Return the robot with modes and nodes anew of those links whose beams or modal damping changed.

    Args:
        robot: the changed one, whose modes and nodes are those of before.
        before: the robot as it was.

    Raises:
        DescriptionError: mass, com or inertia of a link that bends were changed, which follow from its modes.
    """
    links, joints = list(robot.links), list(robot.joints)
    couplings = list(robot.couplings)
    for old in before.links:
        now = next((x for x in links if x.name == old.name), None)
        if old.modes is None or now is None or now.modes is None:
            continue
        body = next((key for key in _BODY if getattr(now, key) != getattr(old, key)), None)
        if body is not None:
            source = "beam" if now.beam is not None else "modes"
            message = f"it follows from the link's {source}; allowed: numbers of these"
            raise DescriptionError(message, where=f"links.{old.name}.{body}", source=robot.source)
        new = _remade(now, old)
        links[links.index(now)] = new
        if new.modes is not None and new.modes.nodes != old.modes.nodes:
            _check_names(robot, new.modes, old)
            pairs = [(list(made_of(x))) for x in (old, new)]
            joints = replaced(joints, [x[1] for x in pairs[0]], [x[1] for x in pairs[1]])
            couplings = replaced(couplings, [c for x in pairs[0] for c in x[2]], [c for x in pairs[1] for c in x[2]])
    changed = replace(robot, links=tuple(links), joints=tuple(joints), couplings=tuple(couplings))
    return with_changed_shapes(changed, before)


def _check_names(robot: Robot, new: LinkModes, old: Link) -> None:
    """Refuse other nodes than there were, since joints and links stand for them."""
    assert old.modes is not None
    names, before = ([node.name for node in modes.nodes] for modes in (new, old.modes))
    if names != before:
        message = f"its nodes would be {listed(names)}; allowed: those of the description, {listed(before)}"
        raise DescriptionError(message, where=f"links.{old.name}.beam.nodes", source=robot.source)


def _remade(now: Link, old: Link) -> Link:
    """Return a changed link with what follows from its beam or its modal damping."""
    if now.beam is not None and now.beam != old.beam:
        return link_of_beam(now.name, _same_section(now.beam, old), now.modal_damping)
    if now.modal_damping != old.modal_damping and now.modes is not None:
        from ...bending.constants import as_tuples, modal_damping

        D = modal_damping(now.modes.masses, now.modes.K, now.modal_damping or 0.0)
        return replace(now, modes=replace(now.modes, D=as_tuples(D)))
    return now


def _same_section(beam: LinkBeam, old: Link) -> LinkBeam:
    """Return a changed beam without the form of its section where that has other numbers now."""
    if old.beam is not None and beam.section != old.beam.section:
        message = "its numbers follow from it when a description is read; allowed: A, Iy, Iz and J"
        raise DescriptionError(message, where=f"links.{old.name}.beam.section")
    changed = old.beam is not None and any(getattr(beam, key) != getattr(old.beam, key) for key in OF_SECTION)
    return replace(beam, section=None) if changed else beam


def _beam(table: Table) -> LinkBeam:
    """Read the table of a link's beam, of the keys ``LINK_BEAM``."""
    numbers = {key: table.number(key) or 0.0 for key in ("length", "E", "G", "density")}  # all of them are needed
    section, counts = read_section(table, numbers["E"], numbers["G"]), table.table("modes")
    assert counts is not None
    beam = LinkBeam(
        A=section.A,
        Iy=section.Iy,
        Iz=section.Iz,
        J=section.J,
        shear=(section.shear[0], section.shear[1]),
        modes=BeamModes(**{key: counts.value(key, Whole) for key in counts.keys if key in counts}),
        nodes=table.value("nodes", ByName) or {},
        axis=table.choice("axis") or "x",
        section=section.form,
        **numbers,
    )
    conflict = beam.conflict()
    if conflict is not None:
        table.fail(conflict[1], conflict[0])
    return beam


def _link_of_file(name: str, entry: Table, folder: Path | None, damping: float | None, draft: Draft) -> Link:
    """Return the link of a file of modes or of finite elements."""
    from ...bending.constants import as_tuples, body_of, modal_damping
    from ...bending.link_files import read_link

    path, how = _file_in(entry)
    if folder is None:
        entry.fail(f"got {show(path)}; allowed: the path of a .npz file, relative to this file", "modes")
    try:
        body = read_link(folder / path, how)
        modes = body.modes
        if damping is not None:
            if any(map(any, modes.D)):
                entry.fail("the file has D; allowed: one of them", "modal_damping")
            modes = replace(modes, D=as_tuples(modal_damping(modes.masses, modes.K, damping)))
        link = Link(name, *body_of(body.H00), modes, None, damping)
    except DescriptionError:
        raise
    except InputError as error:
        entry.fail(str(error), "modes")
    if not all(abs(x) <= LARGEST for x in (link.mass, *link.com, *link.inertia)):
        entry.fail(
            f"{path}: mass, com or inertia of H00 are beyond {LARGEST:g}; allowed: numbers of usual sizes", "modes"
        )
    if body.is_free:
        draft.free_modes.add(name)
    draft.notes += [f"links.{name}.modes: {note}" for note in body.notes()]
    return link


def _file_in(entry: Table) -> tuple[str, HowToTake | None]:
    """Return the path under the key ``modes``, and how the file is taken where its table says so."""
    from ...bending.link_files import HowToTake

    table: str | Table = entry.value("modes")
    if isinstance(table, str):
        return table, None
    place, count = table.table("placement"), table.whole("count", -1)
    pose = Placement() if place is None else read_placement(place)
    units = table.choice("units")
    how = HowToTake(
        count=None if count < 0 else count,
        units=units,
        rotation=None if place is None else pose.rotation,
        origin=None if place is None else pose.xyz,
    )
    return table.text("file") or "", how
