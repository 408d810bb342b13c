"""Joints that slide along links that are beams: a load that moves along a beam which bends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

from ...forms.tables import Table
from ...names import listed, show
from ...robot.value import Coupling, Joint, Link, Robot, SlidingParts, sliding_joint, sliding_joints
from ...robot.value.nodes import SLIDING
from ..draft import Draft

_ONLY = ("node", "dh", "placement", "offset", "x", "y", "alpha", "beta", "gamma")  # keys that have no meaning there


def on_beam(entry: Table, joint: Joint, draft: Draft) -> Joint:
    """Return a joint that slides along its parent, with its range; the draft is told.

    Raises:
        DescriptionError: the parent is no beam, the joint is not prismatic, or has what such a joint has not.
    """
    link = draft.links.get(joint.parent)
    if link is None or link.beam is None:
        entry.fail(f"{show(joint.parent)} is no beam; allowed: joints of links with beam", "along")
    if joint.type != SLIDING:
        entry.fail(f"the joint is {joint.type}; allowed: {SLIDING} joints", "along")
    for key in _ONLY:
        if key in entry:
            entry.fail("the joint slides along the beam's axis; allowed: z alone, the distance from its root", key)
    length = link.beam.length
    lower, upper = joint.range
    if math.isinf(lower) and math.isinf(upper):
        joint = replace(joint, limits=(0.0, length))
    elif lower < 0.0 or upper > length:
        entry.fail(f"got {lower:g} to {upper:g} m; allowed: on the beam, 0 to {length:g} m", "limits")
    draft.sliding.append(joint.name)
    return joint


def add_sliding(draft: Draft) -> None:
    """Add the links, joints and couplings that joints along beams are made of.

    Raises:
        DescriptionError: others have their names.
    """
    for joint in [draft.joints[name] for name in draft.sliding]:
        parts = _parts(joint, draft.links[joint.parent])
        slides, bent = parts.joints
        groups = ((draft.links, (parts.link,)), (draft.joints, (bent,)), (draft.couplings, parts.couplings))
        taken = [x.name for group, items in groups for x in items if x.name in group or x.name == draft.base]
        if taken:
            message = f"where it stands is a link, a joint and couplings of the names {listed(taken)}, which are taken"
            draft.fail(f"joints.{joint.name}", f"{message}; allowed: another name of either")
        draft.links[parts.link.name] = parts.link
        draft.joints |= {slides.name: slides, bent.name: bent}
        draft.couplings |= {x.name: x for x in parts.couplings}


def with_changed_shapes(robot: Robot, before: Robot) -> Robot:
    """Return the robot with the shape functions of its beams where joints slide along those that changed."""
    joints, couplings = list(robot.joints), list(robot.couplings)
    for slides, bent in sliding_joints(before.joints, before.couplings).values():
        link = robot.link(slides.parent)
        if link == before.link(link.name):
            continue
        joint, old_beam = robot.joint(slides.name), before.link(link.name).beam
        if old_beam is not None and link.beam is not None and joint.limits == (0.0, old_beam.length):
            joint = replace(joint, limits=(0.0, link.beam.length))
        made = _parts(replace(joint, child=bent.child), link)
        old = [x for x in before.couplings if x.sliding is not None and x.of.startswith(f"{bent.name}.")]
        joints = replaced(joints, [slides, bent], made.joints)
        couplings = replaced(couplings, old, made.couplings)
    return replace(robot, joints=tuple(joints), couplings=tuple(couplings))


def _parts(joint: Joint, link: Link) -> SlidingParts:
    from ...bending.beam import shapes_along  # NumPy, which robots without such links are read without

    assert link.beam is not None
    return sliding_joint(joint, link, shapes_along(link.beam))


Item = TypeVar("Item", Joint, Coupling)


def replaced(items: Iterable[Item], old: Sequence[Item], new: Sequence[Item]) -> list[Item]:
    """Return items with the new ones where the first of the old ones stood."""
    names = {x.name for x in old}
    result: list[Item] = []
    pending = list(new)
    for item in items:
        if item.name in names:
            result += pending
            pending = []
        else:
            result.append(item)
    return result + pending
