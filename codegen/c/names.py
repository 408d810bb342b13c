"""Names in generated C: identifiers of what arrays are numbered by, names of entries, and texts of statuses."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from typing import Any

from ..kernels.entries import ARRAYS

# Keywords up to C++23, alternative operators, std, and macros that compilers or common headers define in small letters.
TAKEN = frozenset(
    """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t char32_t class compl
    concept const consteval constexpr constinit const_cast continue co_await co_return co_yield decltype default delete
    do double dynamic_cast else enum explicit export extern false float for friend goto if inline int long mutable
    namespace new noexcept not not_eq nullptr operator or or_eq private protected public register reinterpret_cast
    requires return short signed sizeof static static_assert static_cast struct switch template this thread_local throw
    true try typedef typeid typename union unsigned using virtual void volatile wchar_t while xor xor_eq
    std posix linux unix i386 assert errno stdin stdout stderr complex imaginary near far small interface major minor
    emit signals slots foreach NULL EOF TRUE FALSE NAN INFINITY OVERFLOW UNDERFLOW DOMAIN SING I
    """.split()  # noqa: SIM905
)

# Names of the places along axes of a fixed length, by the array, or by the length.
COMPONENTS: Mapping[str | int, tuple[str, ...]] = {
    **dict.fromkeys(
        ("wrench", "reactions", "loop_reactions"), ("force x", "force y", "force z", "moment x", "moment y", "moment z")
    ),
    "pair": ("kinetic", "potential"),
    "momenta": ("momentum", "C^T v"),
    "law_pairs": ("deviation", "force"),
    "spring_pairs": ("length", "tension"),
    "element_pairs": ("value", "force"),
    "derivatives": ("by q", "by v", "by a or u"),
    3: ("x", "y", "z"),
    6: ("linear x", "linear y", "linear z", "angular x", "angular y", "angular z"),
}
HEADINGS = {
    "coordinate": "Coordinates, in the order of q.",
    "joint": "Joints, in the order of reactions.",
    "link": "Links, in the order of wrench.",
    "frame": "Frames, by number.",
    "parameter": "Run-time parameters, in the order of p.",
    "spring": "Springs between two points, by number.",
    "constraint": "Constraints of the loops, in the order of g.",
    "state": "Internal states, in the order of z; rollouts have them behind v, forward_dynamics their derivatives.",
}
VIOLATIONS = ("the constraint is violated", "the rate of the constraint is not zero", "accelerations violate it")


def name_tables(meta: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return tables of names by which arrays are numbered, with identifiers; frames' numbers have a separate type."""
    names = {key: meta[f"{key}s"] for key in ("coordinate", "joint", "link", "frame", "parameter")}
    names |= {key: meta[f"{key}s"] for key in ("spring", "constraint") if f"{key}s" in meta}
    names |= {"state": meta["internal_states"]} if "internal_states" in meta else {}
    return [{"key": key, "names": identifiers(list(x)), "has_type": key == "frame"} for key, x in names.items()]


def safe(name: str) -> str:
    """Return the name, with _ behind it where it is a word of C++."""
    return f"{name}_" if name in TAKEN else name


def identifiers(names: Sequence[str]) -> list[tuple[str, str]]:
    """Pair each name with a distinct identifier of C++: joint1_x of "joint1.x"."""
    pairs: list[tuple[str, str]] = []
    used: set[str] = set()
    for name in names:
        identifier = safe(re.sub(r"\W", "_", name))
        while identifier in used:
            identifier += "_"
        used.add(identifier)
        pairs.append((name, identifier))
    return pairs


def entry_names(array: str, shape: Sequence[int], meta: Mapping[str, Any]) -> list[str]:
    """Return a name for each number of an array, in its order: of the row, then of the column, and so on.

    Args:
        array: name of the array.
        shape: of it.
        meta: metadata of the package.
    """
    known = ARRAYS.get(array)
    axes = known.axes if known is not None and len(known.axes) == len(shape) else tuple(shape)
    rates = [*meta["coordinates"], *meta.get("internal_states", ())]
    numbered = {"rates": rates, "inertial_parameters": meta.get("regressor", ()), "loops": tuple(meta.get("loops", ()))}
    names = []
    for axis, length in zip(axes, shape, strict=True):
        found = numbered.get(str(axis), meta.get(axis, ())) if isinstance(axis, str) else COMPONENTS.get(array, ())
        if len(found) != length and isinstance(axis, int) and array not in ("pose", "cut_poses", "poses"):
            found = COMPONENTS.get(axis, ())
        names.append(list(found) if len(found) == length else [str(i) for i in range(length)])
    return [", ".join(parts) for parts in itertools.product(*names)]


def status_texts(coordinates: Sequence[str], constraints: Sequence[str]) -> list[str]:
    """Return what each status of a kernel means, from 0 on."""
    texts = ["ok", *(f"{name}: the mass matrix cannot be inverted" for name in coordinates)]
    if constraints:
        texts += [f"{name}: {text}" for text in VIOLATIONS for name in constraints]
        texts += [f"{name}: no drive gives the force that it needs" for name in coordinates]
    return texts
