"""Functions whose values are kept: each is worked out once for an object, a robot say."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, Generic, TypeVar, cast

KEPT = 16  # objects whose values a function keeps

Owner = TypeVar("Owner")
Function = TypeVar("Function", bound=Callable[..., Any])


class _Same(Generic[Owner]):
    """An object as a key that is equal to itself alone: equal numbers may have other signs of zero."""

    def __init__(self, owner: Owner) -> None:
        self.owner = owner

    def __hash__(self) -> int:
        return id(self.owner)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.owner is self.owner


def kept(function: Function) -> Function:
    """Return the function, which keeps what it gives for the last ``KEPT`` objects; errors are raised each time."""

    first = function.__code__.co_varnames[0]

    @lru_cache(maxsize=KEPT)
    def value(same: _Same[Any], *args: Any, **further: Any) -> Any:
        return function(same.owner, *args, **further)

    @wraps(function)
    def once(*args: Any, **further: Any) -> Any:
        owner, rest = (args[0], args[1:]) if args else (further.pop(first), ())
        return value(_Same(owner), *rest, **further)

    return cast(Function, once)
