"""Decorator that makes a function return a plausible wrong value; this text is inserted into mutated files."""

import copy
import dataclasses
import enum
import functools
import inspect
import io
import numbers
import pathlib
import sys
import types
from collections.abc import Callable, Iterator, Set
from typing import Any

KINDS = ("sign", "factor", "part", "zero")  # tried from the one that is asked for, in this order
PROCEDURE, CONTROL = "procedure", "control"  # the body is not run; nothing is changed
UNCHANGED = object()


def wrong(kind: str, pick: int = 0, log: str = "") -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the decorator; ``pick`` chooses entries and fields, ``log`` is the file that changes are noted in."""
    noted: set[str] = set()

    def note(what: str) -> None:
        if log and what not in noted:
            noted.add(what)
            with open(log, "a", encoding="utf-8") as file:
                file.write(what + "\n")

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        if kind == CONTROL:
            return functools.wraps(function)(lambda *args, **kwargs: function(*args, **kwargs))
        if kind == PROCEDURE:
            return functools.wraps(function)(lambda *args, **kwargs: note("changed"))
        if inspect.isgeneratorfunction(function):

            @functools.wraps(function)
            def generator(*args: Any, **kwargs: Any) -> Iterator[Any]:
                note("changed")
                yield from shortened(function(*args, **kwargs), kind)

            return generator

        @functools.wraps(function)
        def changed(*args: Any, **kwargs: Any) -> Any:
            value = function(*args, **kwargs)
            new = altered(value, kind, pick)
            if new is UNCHANGED and (value is None or (hasattr(value, "__len__") and len(value) == 0)):
                note("called")
                return value
            note("changed")
            return None if new is UNCHANGED else new

        return changed

    return decorate


def altered(value: Any, kind: str, pick: int = 0, depth: int = 0) -> Any:
    """Return a wrong value of the same type, UNCHANGED where there is none."""
    first = KINDS.index(kind)
    for other in (*KINDS[first:], *KINDS[:first]) if depth < 5 else ():
        try:
            new = _altered(value, other, pick, depth)
            if new is not UNCHANGED and not _same(value, new):
                return new
        except Exception:  # a type with rules of its own
            continue
    return UNCHANGED


def shortened(items: Iterator[Any], kind: str) -> Iterator[Any]:
    """Yield all but the last item, nothing with kind "zero"."""
    before = UNCHANGED
    for item in items if kind != "zero" else ():
        if before is not UNCHANGED:
            yield before
        before = item


def _same(one: Any, other: Any) -> bool:
    numpy = sys.modules.get("numpy")
    if numpy is not None and isinstance(one, numpy.ndarray):
        return bool(numpy.array_equal(one, other, equal_nan=one.dtype.kind in "fc"))
    try:
        return bool(one == other) or bool(one != one and other != other)
    except Exception:  # arrays inside
        return False


def _altered(value: Any, kind: str, pick: int, depth: int) -> Any:
    numpy = sys.modules.get("numpy")
    if value is None or isinstance(value, type | types.ModuleType):
        return UNCHANGED
    if isinstance(value, bool) or (numpy is not None and isinstance(value, numpy.bool_)):
        return type(value)(not value)
    if isinstance(value, enum.Enum):
        members = list(type(value))
        return members[(members.index(value) + 1) % len(members)]
    if isinstance(value, numbers.Number):
        step = 1 if isinstance(value, numbers.Integral) else 0.1 * value + (value == 0)
        return {"sign": lambda: -value, "factor": lambda: value + step, "part": lambda: value - step}.get(
            kind, lambda: type(value)(0)
        )()
    if numpy is not None and isinstance(value, numpy.ndarray):
        return _altered_array(value, kind, pick)
    if isinstance(value, str | bytes):
        lines = value.splitlines(keepends=True)
        at = len(lines) - 1 if kind == "part" else pick % max(len(lines), 1)
        return type(value)().join(lines[:at] + lines[at + 1 :]) if len(lines) > 1 else value[:-1]
    if isinstance(value, pathlib.PurePath):
        return value.with_name(value.name + "_")
    if isinstance(value, dict):
        new = copy.copy(value)
        if kind == "zero":
            new.clear()
        elif kind == "part":
            new.popitem()
        else:
            key = _first_changed(new, list(new), lambda key: new[key], kind, pick, depth)
            new[key[0]] = key[1]
        return new
    if isinstance(value, Set):
        return type(value)(sorted(value, key=repr)[: 0 if kind == "zero" else -1])  # type: ignore[call-arg]
    if isinstance(value, list | tuple) and not hasattr(value, "_fields"):
        return _altered_sequence(value, kind, pick, depth)
    if isinstance(value, Iterator) and not isinstance(value, io.IOBase):
        return shortened(value, kind)
    if isinstance(value, types.FunctionType | types.MethodType | functools.partial):
        return wrong(kind, pick)(value)
    if hasattr(type(value), "__neg__"):  # expressions, matrices
        return {"sign": lambda: -value, "factor": lambda: 2 * value, "zero": lambda: 0 * value}.get(kind, _unchanged)()
    return _altered_object(value, kind, pick, depth)


def _unchanged() -> Any:
    return UNCHANGED


def _altered_array(value: Any, kind: str, pick: int) -> Any:
    if value.dtype.kind not in "iufcb":
        return value[::-1] if kind == "sign" else value[:-1]
    if kind != "part" and value.dtype.kind != "b":
        return {"sign": lambda: -value, "factor": lambda: (value * 1.1).astype(value.dtype)}.get(
            kind, lambda: value * value.dtype.type(0)
        )()
    new = value.copy()
    at = pick % new.size
    new.flat[at] = not new.flat[at] if value.dtype.kind == "b" else new.flat[at] * 2 + (new.flat[at] == 0)
    return new


def _altered_sequence(value: Any, kind: str, pick: int, depth: int) -> Any:
    results = isinstance(value, tuple) and len(value) < 5  # of a function with several: their number stays
    if kind == "sign":
        return value[::-1] if len({type(x) for x in value}) == 1 else UNCHANGED
    if kind == "factor" or results:
        at, new = _first_changed(value, range(len(value)), value.__getitem__, kind, pick, depth)
        return type(value)([*value[:at], new, *value[at + 1 :]])
    return value[:0] if kind == "zero" else value[:-1]


def _altered_object(value: Any, kind: str, pick: int, depth: int) -> Any:
    if hasattr(value, "_fields") and isinstance(value, tuple):
        name, new = _first_changed(value, value._fields, value.__getattribute__, kind, pick, depth)
        return value._replace(**{name: new})  # type: ignore[attr-defined]
    fields = [f.name for f in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else [*vars(value)]
    name, new = _first_changed(value, fields, value.__getattribute__, kind, pick, depth)
    other = copy.copy(value)
    for key in [*vars(other)] if hasattr(other, "__dict__") else ():  # what follows from fields is computed anew
        if isinstance(getattr(type(other), key, None), functools.cached_property):
            del other.__dict__[key]
    object.__setattr__(other, name, new)
    return other


def _first_changed(value: Any, keys: Any, get: Callable[[Any], Any], kind: str, pick: int, depth: int) -> Any:
    keys = list(keys)
    at = pick % len(keys)
    for texts in (False, True):  # names and messages last
        for key in [*keys[at:], *keys[:at]]:
            if isinstance(get(key), str) == texts:
                new = altered(get(key), kind, pick, depth + 1)
                if new is not UNCHANGED:
                    return key, new
    raise LookupError(value)
