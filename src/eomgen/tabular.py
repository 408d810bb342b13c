"""Results as tables of other people's tools: frames of pandas, data sets of xarray, where those are installed."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .optional import optional_import

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class TableColumn:
    """Values of a name, one for each row, (N,), or a few with ``labels``, (N, k), in their unit.

    ``over`` says what the labels are: "axis" of x, y and z.
    """

    name: str
    unit: str
    values: NDArray[Any]
    labels: tuple[str, ...] = ()
    over: str = "axis"

    def flat(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Name and values, (N,), of each label: ``tcp.position.x``."""
        if not self.labels:
            yield self.name, self.values
            return
        for label, values in zip(self.labels, self.values.T, strict=True):
            yield f"{self.name}.{label}", values


@dataclass(frozen=True)
class Rows:
    """A table: what its rows are by, ``index`` and its values (N,) in their unit; columns; what it is about."""

    index: str
    unit: str
    values: NDArray[Any]
    columns: Sequence[TableColumn]
    about: Mapping[str, str] = field(default_factory=dict)


class Tabular:
    """Base of results that are tables."""

    @abstractmethod
    def as_rows(self) -> Rows:
        """Return the rows and columns that ``to_pandas`` and ``to_xarray`` give."""

    def to_pandas(self) -> Any:
        """Return the columns as a ``pandas.DataFrame``, by names; ``attrs["units"]`` has the unit of each, SI and rad.

        Raises:
            InputError: pandas is not installed.
        """
        with optional_import("pandas", "to_pandas needs"):
            import pandas
        rows = self.as_rows()
        flat = {name: (column.unit, values) for column in rows.columns for name, values in column.flat()}
        index = pandas.Index(rows.values, name=rows.index)
        frame = pandas.DataFrame({name: values for name, (_, values) in flat.items()}, index=index)
        units = {rows.index: rows.unit, **{name: unit for name, (unit, _) in flat.items()}}
        frame.attrs = {**rows.about, "units": units}
        return frame

    def to_xarray(self) -> Any:
        """Return the columns as an ``xarray.Dataset`` with a coordinate of rows; variables have ``attrs["units"]``.

        Raises:
            InputError: xarray is not installed.
        """
        with optional_import("xarray", "to_xarray needs"):
            import xarray
        rows = self.as_rows()
        coordinates: dict[str, Any] = {rows.index: (rows.index, rows.values, {"units": rows.unit})}
        variables: dict[str, Any] = {}
        for column in rows.columns:
            over = [column.over] if column.labels else []
            coordinates |= {column.over: (column.over, np.array(column.labels))} if over else {}
            variables[column.name] = ([rows.index, *over], column.values, {"units": column.unit})
        return xarray.Dataset(variables, coordinates, dict(rows.about))
