"""Tables of links and joints in descriptions as TOML."""

from __future__ import annotations

from collections.abc import Sequence


def link_table(name: str, mass: object, com: Sequence[object] = (), inertia: Sequence[object] = ()) -> str:
    """Return a link's table, without ``com`` or ``inertia`` (xx, yy, zz) if these are not given."""
    table = f'[[links]]\nname = "{name}"\nmass = {mass}'
    if com:
        table += f"\ncom = [{', '.join(map(str, com))}]"
    if inertia:
        table += "\ninertia = {{ xx = {}, yy = {}, zz = {} }}".format(*inertia)
    return table


def joint_table(name: str, parent: str, child: str, kind: str) -> str:
    """Return the beginning of a joint's table, behind which further keys of it may stand."""
    return f'[[joints]]\nname = "{name}"\nparent = "{parent}"\nchild = "{child}"\ntype = "{kind}"'
