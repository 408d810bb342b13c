"""Tables of links, beams, joints, frames, loops and springs in descriptions as TOML."""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.robot.value import INERTIA_KEYS


def link_table(name: str, mass: object, com: Sequence[object] = (), inertia: Sequence[object] = ()) -> str:
    """Return a link's table, without ``com`` or ``inertia`` (moments, or these and products) if these are not given."""
    table = f'[[links]]\nname = "{name}"\nmass = {mass}'
    if com:
        table += f"\ncom = [{', '.join(map(str, com))}]"
    if inertia:
        moments = ", ".join(f"{key} = {value}" for key, value in zip(INERTIA_KEYS, inertia, strict=False))
        table += f"\ninertia = {{ {moments} }}"
    return table


def beam_table(name: str, length: float, section: str, modes: str, G: float = 2.6e10) -> str:
    """Return the table of a link that is a beam of aluminium; further keys of its beam may stand behind it."""
    return (
        f'[[links]]\nname = "{name}"\n[links.beam]\nlength = {length}\nE = 7e10\nG = {G}\ndensity = 2700.0\n'
        f"section = {section}\nmodes = {modes}"
    )


def joint_table(name: str, parent: str, child: str, kind: str) -> str:
    """Return the beginning of a joint's table, behind which further keys of it may stand."""
    return f'[[joints]]\nname = "{name}"\nparent = "{parent}"\nchild = "{child}"\ntype = "{kind}"'


def frame_table(name: str, link: str, xyz: Sequence[object] = ()) -> str:
    """Return a frame's table, with its placement if ``xyz`` is given; further keys may stand behind it."""
    placement = f"\nplacement = {{ xyz = [{', '.join(map(str, xyz))}] }}" if xyz else ""
    return f'[[frames]]\nname = "{name}"\nlink = "{link}"{placement}'


def loop_table(name: str, first: str, second: str, kind: str) -> str:
    """Return the beginning of a loop joint's table, behind which further keys of it may stand."""
    return f'[[loops]]\nname = "{name}"\nlinks = ["{first}", "{second}"]\ntype = "{kind}"'


def spring_table(name: str, first: str, second: str, stiffness: object, damping: object) -> str:
    """Return the beginning of a spring's table, behind which further keys of it may stand."""
    return (
        f'[[springs]]\nname = "{name}"\nlinks = ["{first}", "{second}"]\nstiffness = {stiffness}\ndamping = {damping}'
    )
