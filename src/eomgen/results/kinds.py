"""Kinds of results: each is declared once, and written, read and checked by what it declares.

A field of a result is plain (JSON), or an array where ``Stored`` says how files hold it.  Derived values are no fields
of a file: ``record`` has the values that they are rebuilt from, and ``rebuild`` rebuilds them.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files import as_path, check_ending, write_csv
from ..forms.plain import field_types, value_of
from ..names import show
from ..npz import COMPLEX, read_npz
from .contents import FORMAT, JSON, META, NPZ, Contents, plain_of, read_json, write_json, write_npz
from .stored import ALLOWED, REQUIRED, Stored, stored_fields

Result = TypeVar("Result", bound="Saved")
Read = TypeVar("Read", bound="Saved", covariant=True)

KINDS: dict[str, Kind[Any]] = {}  # by the names that files say
_NO_NUMBER = re.compile(r"(?<![\w.])(?:nan|inf)(?![\w.])")
_DAMAGED = (  # what values that do not go together raise
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    ArithmeticError,
    AssertionError,
    RecursionError,
)


class Saved:
    """Base of results of a declared kind: they are saved, and read by ``eomgen.load_result``."""

    def save(self, path: Path | str) -> Path:
        """Write the result, to a temporary name first, and return the path; ``eomgen.load_result`` reads it.

        Raises:
            InputError: another ending than that of its kind (.npz or .json), or the file cannot be written.
        """
        return write(self, path)


class SavedColumns(Saved):
    """Base of results that are tables of columns, too."""

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Return columns by their names, (N,) each."""
        raise NotImplementedError

    def save(self, path: Path | str) -> Path:
        """Write ``columns`` as .csv (numbers round-trip), or the result as .npz, and return the path.

        ``eomgen.load_result`` reads an .npz.

        Raises:
            InputError: another ending, or the file cannot be written.
        """
        target = check_ending(path, ".csv", NPZ)
        if target.suffix == NPZ:
            return write(self, target)
        columns = self.columns()
        return write_csv(
            target, [columns, *zip(*(map(repr, x.tolist()) for x in columns.values()), strict=True)], read=None
        )


class Loader(Protocol[Read]):
    """A function that reads results of one kind."""

    def __call__(self, path: Path | str) -> Read: ...


@dataclass(frozen=True)
class Kind(Generic[Result]):
    """A kind of result, as its files say it.

    Attributes:
        name: by which files say of which kind they are.
        result: a dataclass; its fields are plain values, or arrays that are declared by ``Stored``.
        ending: of files, .npz or .json.
        what: how messages call it, "is no WHAT"; default the name.
        rebuilt: names of fields that files do not have as they are.
        record: gives what these are rebuilt from: plain values, and arrays, by names.
        rebuild: gives these fields, by name, of a file.
        read: makes a whole result of a file where that is more than fields; else they are read as they are declared.
        sizes: gives sizes of a result by the letters of shapes, beside those that tuples of names have; the first array
            that has any other says how many.
        check: refuses a result whose values do not go together; it has the file's name for messages.
        is_finite: whether all numbers are finite that the result's lines show.
        is_bare: whether files of older versions have arrays alone.
    """

    name: str
    result: type[Result]
    ending: str = NPZ
    what: str = ""
    rebuilt: tuple[str, ...] = ()
    record: Callable[[Result], Mapping[str, Any]] = lambda _: {}
    rebuild: Callable[[Contents], Mapping[str, Any]] = lambda _: {}
    read: Callable[[Contents], Result] | None = None
    sizes: Callable[[Result], Mapping[str, int]] = lambda _: {}
    check: Callable[[Result, str], None] = lambda result, path: None
    is_finite: bool = True
    is_bare: bool = False

    @cached_property
    def arrays(self) -> dict[str, Stored]:
        """How files hold the fields that are arrays, by name."""
        return {name: self.stored[name] for name, kind in self.types.items() if _is_array(kind, self.stored.get(name))}

    @property
    def first_arrays(self) -> set[str]:
        """Names of the arrays that files of all versions have."""
        return {name for name, stored in self.arrays.items() if stored.otherwise is REQUIRED}

    @cached_property
    def stored(self) -> dict[str, Stored]:
        """How files hold fields of which that is declared, by name."""
        return stored_fields(self.result)

    @cached_property
    def types(self) -> dict[str, Any]:
        """Types of the fields of files, by name."""
        return {name: kind for name, kind in field_types(self.result).items() if name not in self.rebuilt}


def _is_array(kind: Any, stored: Stored | None) -> bool:
    origin = getattr(getattr(kind, "__origin__", None), "__name__", "")
    is_array = origin in ("ndarray", "NDArray")  # the latter from NumPy 2.5 on, whose NDArray is an alias by itself
    return stored is not None and (is_array or stored.of is str)


def declare(kind: Kind[Result]) -> Loader[Result]:
    """Register a kind of result, and return the function that reads its files."""
    KINDS[kind.name] = kind

    def load(path: Path | str) -> Result:
        return read(kind, as_path(path))

    load.__name__ = load.__qualname__ = f"load_{kind.name}"
    load.__annotations__["return"] = kind.result.__name__
    load.__doc__ = f"""Read the result that ``{kind.result.__name__}.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no such result; says what in it is wrong.
    """
    return load


def write(result: Saved, path: Path | str) -> Path:
    """Write a result of a declared kind, to a temporary name first, and return the path.

    Raises:
        InputError: another ending than that of its kind, or the file cannot be written, or cannot be read back.
    """
    kind = next(kind for kind in KINDS.values() if kind.result is type(result))
    values = dict(kind.record(result)) | {name: getattr(result, name) for name in kind.types}
    plain = {"kind": kind.name, "format": FORMAT}
    if kind.ending == JSON:
        return write_json(path, plain | values, partial(read, kind))
    texts = [name for name, item in kind.arrays.items() if item.of is str]
    arrays = {name: x for name, x in values.items() if name in kind.arrays or isinstance(x, np.ndarray)}
    arrays = {name: np.asarray(x, str if name in texts else None) for name, x in arrays.items()}
    plain |= {name: x for name, x in values.items() if name not in arrays}
    return write_npz(check_ending(path, NPZ), plain, arrays, partial(read, kind))


def read(kind: Kind[Result], path: Path | str) -> Result:
    """Read the result of a file of a kind.

    Raises:
        InputError: the file cannot be read, is of another kind, or is damaged; names the file, and what in it is wrong.
    """
    contents = contents_of(kind, path)
    with damage_named(path, kind.what or kind.name):
        loaded: Any = kind.read(contents) if kind.read else _of_declared(kind, contents)
        _check_arrays(kind, loaded, str(path))
        kind.check(loaded, str(path))
        if kind.is_finite:
            check_finite(loaded, str(path))
        else:
            loaded.lines()
    result: Result = loaded
    return result


def contents_of(kind: Kind[Any], path: Path | str) -> Contents:
    """Read the values of a file; only its kind is checked.

    Raises:
        InputError: the file cannot be read, or is of another kind; names the file.
    """
    arrays = {} if kind.ending == JSON else read_npz(path, kinds=COMPLEX)
    plain = read_json(path) if kind.ending == JSON else plain_of(arrays, str(path))
    if plain is None and kind.is_bare:
        plain = {"kind": kind.name, "format": FORMAT}
    if not isinstance(plain, dict) or plain.get("kind") != kind.name or plain.get("format") != FORMAT:
        raise InputError(f"{path}: is no result of the kind {kind.name}; {ALLOWED}")
    return Contents(str(path), {key: x for key, x in plain.items() if key not in ("kind", "format")}, arrays)


def kind_of(path: Path | str) -> str | None:
    """Return the kind that a file says its result is of; "" where it says none, None where it has arrays alone.

    Raises:
        InputError: the file cannot be read; names the file.
    """
    if Path(path).suffix == JSON:
        plain = read_json(path)
    else:
        arrays = read_npz(path, (META,))
        if META not in arrays:
            return None
        plain = plain_of(arrays, f"{path}: {META}")
    kind = plain.get("kind") if isinstance(plain, dict) else None
    return kind if isinstance(kind, str) else ""


def bare_kind(path: Path | str) -> str | None:
    """Return the kind whose files of older versions have the arrays of a file, and nothing else; None if there is none.

    Raises:
        InputError: the file cannot be read; names the file.
    """
    names = set(read_npz(path, kinds=COMPLEX))
    return next((kind.name for kind in KINDS.values() if kind.is_bare and names == kind.first_arrays), None)


def _of_declared(kind: Kind[Result], contents: Contents) -> Result:
    """Make a result of the fields that are declared."""
    if kind.ending != JSON:
        return kind.result(**fields_of(kind, contents), **kind.rebuild(contents))
    plain: Any = value_of(kind.result, contents.plain, contents.path)
    result: Result = replace(plain, **{name: np.array(getattr(plain, name), np.float64) for name in kind.arrays})
    return result


def fields_of(kind: Kind[Any], contents: Contents) -> dict[str, Any]:
    """Read the fields of a result as they are declared, by name; those that are rebuilt are left out.

    Raises:
        InputError: one is missing, or of another type than is declared; names the file and the field.
    """
    values = {}
    for name, declared in kind.types.items():
        stored = kind.stored.get(name, Stored())
        present = contents.arrays if name in kind.arrays else contents.plain
        if stored.otherwise is not REQUIRED and name not in present:
            values[name] = stored.otherwise
        elif name in kind.arrays:
            values[name] = contents.array(name, stored)
        else:
            values[name] = contents.value(declared, name, stored.largest)
    return values


def _check_arrays(kind: Kind[Any], result: Any, path: str) -> None:
    """Refuse arrays of other shapes than are declared, and numbers in them that are not allowed."""
    named = [(x.shape[0], getattr(result, name), x.otherwise) for name, x in kind.stored.items() if len(x.shape) == 1]
    tuples = {str(letter): names for letter, names, other in named if isinstance(names, tuple) and names != other}
    sizes = {letter: len(names) for letter, names in tuples.items()} | dict(kind.sizes(result))
    for name, stored in kind.stored.items():
        array = getattr(result, name)
        if isinstance(array, np.ndarray) and array is not stored.otherwise:
            stored.check(array, sizes, f"{path}: array {name}")


def check_finite(result: Any, path: str) -> None:
    """Check that the lines of a result have finite numbers alone.

    Raises:
        InputError: its lines have what is no number, or a number that is not finite.
    """
    if _NO_NUMBER.search("\n".join(result.lines())):
        raise InputError(f"{path}: it has numbers that are not finite, or too large; {ALLOWED}")


@contextmanager
def damage_named(path: Path | str, what: str) -> Iterator[None]:
    """Turn errors of code that makes a result of a file's values into an InputError, "PATH: is no WHAT".

    Refusals that do not name the file get its name.
    """
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)
            yield
    except InputError as error:
        if str(path) in str(error):
            raise
        allowed = "" if "allowed: " in str(error) else f"; {ALLOWED}"
        raise InputError(f"{path}: {error}{allowed}") from None
    except _DAMAGED as error:
        why = f"{type(error).__name__}: {error}" if not isinstance(error, (ValueError, AssertionError)) else str(error)
        raise InputError(f"{path}: is no {what} ({show(why)}); {ALLOWED}") from None
