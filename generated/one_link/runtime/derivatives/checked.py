"""Kernels that refuse results which rounding may have moved by more than what is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError
from ...names import nearest_or_all, show
from ..arrays import flag, place_of
from ..raw import Array

Most = float | Mapping[str, ArrayLike]


class WithBounds(Protocol):
    """Protocol of kernels that bound errors of their methods."""

    name: str

    def with_errors(self, name: str, args: Sequence[Any], *, most: ArrayLike | None = None) -> Any:
        """Return a method's result and its bounds."""

    def bounded_methods(self) -> tuple[str, ...]:
        """Name the methods that have bounds."""


class CheckedKernel:
    """Methods of a kernel under their names, of which each refuses results that rounding may have spoilt.

    They take what the methods take but for ``wrench``, ``out`` and ``z``, for one state or many, and return what these
    do; ``assemble`` takes ``held``.  Methods without bounds of their rounding errors, among them rollouts and
    derivatives, are not there.

    Attributes:
        kernel: whose parameters, threads and coordinates count.
        most: the largest bound: a share of the largest number of a state's result, or by the names of methods numbers
            or arrays that go with their results.
    """

    def __init__(self, kernel: WithBounds, most: Most) -> None:
        known = kernel.bounded_methods()
        if isinstance(most, Mapping):
            for name in most:
                if name not in known:
                    raise InputError(
                        f"most: {show(name)} has no bounds of rounding errors{nearest_or_all(str(name), known)}"
                    )
        elif isinstance(most, bool) or not isinstance(most, (int, float)) or not 0.0 <= most < np.inf:
            raise InputError(f"most: {show(most)}; allowed: a share from 0 on, or a mapping from methods to numbers")
        self.kernel, self.most, self._known = kernel, most, known

    def __repr__(self) -> str:
        return f"<{self.kernel!r}, checked by errors: most {self.most!r}>"

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._known})

    def __getattr__(self, name: str) -> Callable[..., Array]:
        if name.startswith("_") or name not in self._known:
            raise AttributeError(
                f"{name}: no method of {type(self).__name__} with bounds of rounding errors; allowed:"
                f" {', '.join(self.__dict__.get('_known', ()))}, and all methods of its kernel"
            )
        return partial(self._call, name)

    def _call(self, name: str, *args: Any, cut: bool = False, **keywords: Any) -> Array:
        """Call a method, and refuse its result where its bound is too large."""
        if name == "assemble" and "held" in keywords:
            args = (*args, keywords.pop("held"))
        if keywords:
            raise InputError(
                f"{name}: {', '.join(keywords)} has no bounds of rounding errors; allowed: the arrays of the method"
                " in their order, and cut"
            )
        function = f"tree_{name}" if flag("cut", cut) and f"tree_{name}" in self._known else name
        if isinstance(self.most, Mapping):
            if name not in self.most:
                raise InputError(f"most: has no number for {name}; has: {', '.join(self.most)}")
            value: Array = self.kernel.with_errors(function, args, most=self.most[name])[0]
            return value
        found = self.kernel.with_errors(function, args)
        value, bound = found
        inner = tuple(range(found.proved.ndim, value.ndim))
        size, largest = (np.abs(x).max(axis=inner, initial=0.0).astype(np.float64) for x in (value, bound))
        refused = ~(largest <= self.most * size) | ~found.proved
        if refused.any():
            where = tuple(int(i) for i in np.argwhere(refused)[0])
            what = "" if found.proved[where] else ", an estimate that is not proved"
            raise ArrayError(
                f"{name}: rounding moves the result{place_of(list(where))} by up to {float(largest[where]):.3g}{what},"
                f" and its largest number is {float(size[where]):.3g}; allowed: {self.most:.3g} of that"
            )
        return value
