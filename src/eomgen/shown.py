"""Results that show themselves: one line at a prompt, a small table in a notebook, a plot; numbers with prefixes."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from .identifiers import show_path
from .names import listed, show

LONGEST = 300  # characters of a line
NAMED = 3  # names of a list that are shown
PREFIXED = ("m", "rad", "s", "N", "J", "W")  # units that take prefixes, also in front of others: N m, m/N
PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "u"), (1e9, "n"), (1e12, "p"))
_MOST_DIGITS = 15


class Shown:
    """Base of dataclasses that hold arrays: arrays are shown by their shape, in ``repr`` and in notebooks.

    They can be pickled and copied, with mappings that cannot be written to as well.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.__repr__ = Shown.__repr__  # type: ignore[method-assign]  # in the class itself, or dataclass writes its own

    def facts(self) -> dict[str, str]:
        """Return names and short texts that are shown: of all fields that are not empty."""
        assert is_dataclass(self)
        values = {field.name: getattr(self, field.name) for field in fields(self) if field.repr}
        return {name: text_of(value) for name, value in values.items() if not _is_empty(value)}

    def __repr__(self) -> str:
        text = ", ".join(f"{name}={value}" for name, value in self.facts().items())
        text = text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
        return f"{type(self).__name__}({text})"

    def __str__(self) -> str:
        """Return what commands print of the result, in lines; ``repr`` where that is one line."""
        lines = getattr(self, "summary_lines", None) or getattr(self, "lines", None)
        return repr(self) if lines is None else "\n".join(lines())

    def __getstate__(self) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Return the attributes by name, mapping proxies as dicts, which can be pickled, and the names of these."""
        values = vars(self)
        proxies = tuple(name for name, value in values.items() if isinstance(value, MappingProxyType))
        return {**values, **{name: dict(values[name]) for name in proxies}}, proxies

    def __setstate__(self, state: tuple[dict[str, Any], tuple[str, ...]]) -> None:
        values, proxies = state
        vars(self).update(values, **{name: MappingProxyType(values[name]) for name in proxies})

    def _repr_html_(self) -> str:
        """Return a table of ``facts``, for notebooks."""
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{html.escape(type(self).__name__)}</caption><tbody>{rows}</tbody></table>"


class Plotting:
    """Base of results that have a plot: ``class Modes(Plotting, Shown, plot="plot_mode_shapes")``, of ``pictures``."""

    _plot: ClassVar[str]

    def __init_subclass__(cls, plot: str, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls._plot = plot

    def plot(self, *about: Any, path: Path | str | None = None, ax: Any = None, **options: Any) -> Any:
        """Plot the result by its function of ``eomgen.pictures``.

        Args:
            about: further arguments of that function: names of series of a simulation, the robot of mode shapes.
            path: of a file to write, .png, .svg or .pdf.
            ax: axes of Matplotlib to draw in, as many as the plot has panels.
            **options: of that function.

        Returns:
            The path where there is one, else (Figure, Axes), or (Figure, array of Axes).

        Raises:
            InputError: Matplotlib is not installed (the extra "sim"), or an argument does not fit.
        """
        from . import pictures

        return getattr(pictures, self._plot)(self, *about, path=path, ax=ax, **options)


def scale_of(values: Any, unit: str) -> tuple[float, str]:
    """Return factor and name of the unit in which the largest of the values is at least 1: (1e6, "um").

    Args:
        values: numbers in the unit; those that are not finite do not count.
        unit: without a prefix; factor 1 where the first of its units takes none: "", "kg", "m^2".
    """
    if re.split("[ /]", unit)[0] not in PREFIXED:
        return 1.0, unit
    sizes = np.abs(values)
    largest = float(sizes[np.isfinite(sizes)].max(initial=0.0))
    for factor, prefix in PREFIXES:
        if factor * largest >= 1.0 or largest == 0.0:
            return factor, prefix + unit
    factor, prefix = PREFIXES[-1]
    return factor, prefix + unit


def prefixed(value: float, unit: str, digits: int = 3, *, sign: bool = False) -> str:
    """Return a quantity as people write it: "31.2 mm" of 0.0312, "m".

    Args:
        value: in the unit.
        unit: without a prefix.
        digits: that count.
        sign: write the sign of positive numbers, too.
    """
    rounded = float(f"{value:.{digits - 1}e}")  # 999.9e-6 is 1 mm
    factor, name = scale_of(rounded, unit)
    number = factor * rounded
    form = ".0f" if 10.0**digits <= abs(number) < 10.0**_MOST_DIGITS else f".{digits}g"
    return f"{number:{'+' if sign else ''}{form}} {name}"


def interval(low: float, high: float, digits: int = 3) -> str:
    """Return both ends with so many digits that they differ in two: "1.00012 .. 1.00034"; at least ``digits``."""
    return " .. ".join(interval_ends(low, high, digits))


def interval_ends(low: float, high: float, digits: int = 3) -> tuple[str, str]:
    """Return the ends of ``interval``."""
    far, width = max(abs(low), abs(high)), abs(high - low)
    if width > 0.0 and math.isfinite(width):
        digits = min(max(digits, math.floor(math.log10(far)) - math.floor(math.log10(width)) + 2), _MOST_DIGITS)
    return f"{low:.{digits}g}", f"{high:.{digits}g}"


def text_of(value: Any) -> str:
    """Describe a value in short, in printable ASCII: numbers and texts as they are, arrays by shape, others by size."""
    if isinstance(value, np.ndarray):
        kind = "" if value.dtype == np.float64 else f" of {value.dtype}"
        return f"<array {value.shape}{kind}>"
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}"
    if isinstance(value, Path):
        return show_path(str(value))
    if isinstance(value, Mapping):
        return f"<{_counted(len(value), 'entry', 'entries')}>"
    if isinstance(value, (tuple, list)):
        if all(isinstance(item, str) and len(item) < 40 for item in value):
            return f"({listed(value, NAMED)})"
        return f"<{_counted(len(value), 'item', 'items')}>"
    if isinstance(value, Shown) or is_dataclass(value):
        return f"<{type(value).__name__}>"
    return show(value)


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"


def _is_empty(value: Any) -> bool:
    return value is None or (isinstance(value, (str, tuple, list, Mapping)) and not value)
