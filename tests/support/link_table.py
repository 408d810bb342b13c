"""Tables of links in descriptions as TOML."""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.robot.value import INERTIA_KEYS


def link_table(name: str, mass: float, com: Sequence[float], inertia: Sequence[float]) -> str:
    """Return a link's table; inertia: three moments about the centre of mass, or these and products, kg m^2."""
    moments = ", ".join(f"{key} = {value}" for key, value in zip(INERTIA_KEYS, inertia, strict=False))
    return f'[[links]]\nname = "{name}"\nmass = {mass}\ncom = {[*com]}\ninertia = {{ {moments} }}'
