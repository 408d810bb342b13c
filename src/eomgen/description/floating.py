"""Floating bases: the joint with all six coordinates between the ground and the first link of a URDF."""

from __future__ import annotations

from collections.abc import Container

from ..names import NAME_LENGTH, component_name, show
from ..robot.value import BASE, COORDINATES, Coordinate, Joint
from .draft import Draft

FLOATING = "floating_base"  # name of the joint
_GROUND = (BASE, "world", "ground")


def float_base(draft: Draft) -> None:
    """Carry the root link of a URDF by a free joint, whose frame is the ground's where all coordinates are zero.

    Raises:
        DescriptionError: the robot is none of a URDF, or its root is carried by a joint already.
    """
    root = draft.base
    if root not in draft.links:
        how = "a joint of the type 'free', in MJCF a <freejoint/>, carries a link that floats"
        carried = [joint.name for joint in draft.joints.values() if joint.parent == root]
        if draft.inherited and carried:
            how = f"without it, as the joint {show(carried[0])} carries the root link of the URDF"
        draft.fail("floating_base", f"there is no root link of a URDF on the ground; allowed: {how}")
    draft.base = _fresh(_GROUND, {*draft.links, *draft.frames})
    name = _fresh((FLOATING,), draft.joints)
    joint = Joint(name, draft.base, root, "free", coordinates={key: Coordinate() for key in COORDINATES})
    draft.joints = {name: joint, **draft.joints}
    first, last = (component_name(name, key) for key in (COORDINATES[0], COORDINATES[-1]))
    draft.notes.append(f"link {show(root)} floats: {first} to {last} are its coordinates")


def _fresh(names: tuple[str, ...], taken: Container[str]) -> str:
    """Return the first of the names that is not taken, or the last of them with a number."""
    free = [name for name in names if name not in taken]
    count = 1
    while not free:
        count += 1
        numbered = f"{names[-1][: NAME_LENGTH - 9]}_{count}"
        free = [numbered] if numbered not in taken else []
    return free[0]
