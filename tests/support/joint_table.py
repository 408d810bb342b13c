"""Tables of joints in descriptions as TOML."""

from __future__ import annotations


def joint_table(name: str, parent: str, child: str, kind: str) -> str:
    """Return the beginning of a joint's table, behind which further keys of it may stand."""
    return f'[[joints]]\nname = "{name}"\nparent = "{parent}"\nchild = "{child}"\ntype = "{kind}"'
