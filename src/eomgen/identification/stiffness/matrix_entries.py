"""Entries of stiffness and damping matrices of joints that are looked for, and the forces that they stand for.

An entry k between two coordinates resists the one by k times the other's deviation (or rate, of damping), and the other
by k times the one's.  The entry of a coordinate with itself is the whole stiffness or damping there: that of the
coordinate's own table is in it, so that what is found is positive semidefinite where the joint is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...errors import InputError, UnknownNameError
from ...names import component_name, nearest, parameter_name, show
from ...robot.elements.joint_damping import lag_of
from ...robot.elements.matrices import PAIRS, entry_name
from ...robot.parameter_names import JOINTS, MOTIONS, STIFFNESSES
from ...robot.value import COORDINATES, PRINCIPAL, Joint, Robot
from ...runtime.kernel import Kernel
from ...state.elements import Numbers, element_numbers
from .result import KEYS

ANY = "*"
_FAMILIES = dict(zip(KEYS, (STIFFNESSES, MOTIONS), strict=True))
_FORMS = "joints.JOINT.stiffness (or damping), of all its coordinates, or joints.JOINT.stiffness.x.beta; * for any word"
_NOT_LINEAR = ("clearance", "stiffness_negative")  # laws that use a coordinate's stiffness otherwise than as a spring


@dataclass(frozen=True)
class Entry:
    """An entry of a joint's matrix: "stiffness" or "damping" between the coordinates one and other, "x" and "beta"."""

    joint: str
    key: str
    one: str
    other: str

    @property
    def entry(self) -> str:
        """Its name in the matrix, "x.beta"."""
        return entry_name(self.one, self.other)

    @property
    def name(self) -> str:
        """Its name in messages, "joint2.stiffness.x.beta"."""
        return ".".join((self.joint, self.key, self.one, self.other))

    @property
    def column(self) -> int:
        """Place of its key in KEYS: 0 acts by deviations, 1 by rates."""
        return KEYS.index(self.key)

    @property
    def columns(self) -> tuple[int, ...]:
        """Places in KEYS of all that is sought of it: one."""
        return (self.column,)

    @property
    def ends(self) -> tuple[str, ...]:
        """Names of its coordinates, one where both are the same."""
        return tuple(dict.fromkeys(component_name(self.joint, name) for name in (self.one, self.other)))

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of coordinates that it resists, each with the one whose deviation or rate counts."""
        one, other = (component_name(self.joint, name) for name in (self.one, self.other))
        return ((one, one),) if one == other else ((one, other), (other, one))

    def parameter(self, _column: int = 0) -> str:
        """Name of the parameter in ``Kernel.parameters``."""
        return parameter_name("joints", self.joint, self.key, self.one, self.other)


@dataclass(frozen=True)
class MatrixNumbers:
    """Numbers of the matrices of joints, and of the tables beside them, as a kernel has them now.

    matrices: by KEYS, then joint and entry.  tables: of coordinates' laws, by their names.
    """

    matrices: Mapping[str, Numbers]
    tables: Numbers

    @classmethod
    def of(cls, kernel: Kernel) -> MatrixNumbers:
        """Read them of a kernel as its parameters are now."""
        return cls({key: element_numbers(kernel, x) for key, x in _FAMILIES.items()}, element_numbers(kernel, JOINTS))

    def described(self, entry: Entry) -> float:
        """Return the value of an entry, with that of a coordinate's table that it takes in."""
        own = self.matrices[entry.key].get(entry.joint, {}).get(entry.entry, 0.0)
        return own + self.tables[entry.ends[0]][entry.key] if self.takes_in(entry) else own

    def takes_in(self, entry: Entry) -> bool:
        """Return whether the coordinate's own table has such a number, linear, which an entry takes in."""
        law = self.tables.get(entry.ends[0], {})
        linear = entry.key != KEYS[0] or not any(law.get(key) for key in _NOT_LINEAR)
        return len(entry.ends) == 1 and bool(law.get(entry.key)) and linear

    def lag(self, entry: Entry) -> float:
        """Return by how much a stiffness's rates count beside its deviations, s: of damping proportional to it."""
        return float(lag_of(self.matrices[KEYS[1]].get(entry.joint, {}))) if entry.key == KEYS[0] else 0.0


def entries_sought(
    robot: Robot, patterns: Sequence[str] | None, label: str = "matrices", *, rigid: bool = False
) -> tuple[Entry, ...]:
    """Return the entries that patterns name, in the order of the joints; those that are described where it is None.

    A pattern is the name of a parameter, ``joints.JOINT.stiffness.x.beta``, in which ``*`` stands for any word; what is
    left out at its end may be anything.  Principal coordinates are named by their word alone, or described.

    Args:
        robot: whose joints they are of.
        patterns: of their names.
        label: of messages.
        rigid: whether coordinates count that the description does not have; ``*`` stands for them in joints without
            deviations alone.

    Raises:
        UnknownNameError: a pattern names no entry.
        InputError: it names damping that is isotropic, or proportional to the stiffness.
    """
    given = {entry for joint in robot.joints for entry in _described(joint)}
    if patterns is None:
        some = [joint for joint in robot.joints if joint.stiffness is not None or joint.damping is not None]
        return tuple(x for joint in some for x in _entries(joint, joint.coordinates) if x in given)
    if not patterns:
        return ()
    every = [entry for joint in robot.joints for entry in _entries(joint, COORDINATES if rigid else joint.coordinates)]
    unwanted = {component_name(x.name, PRINCIPAL[x.type]) for x in robot.joints if x.type in PRINCIPAL}
    for joint in robot.joints if rigid else ():
        if any(component_name(joint.name, name) not in unwanted for name in joint.coordinates):
            unwanted |= {component_name(joint.name, x) for x in COORDINATES if x not in joint.coordinates}
    chosen: set[Entry] = set()
    for pattern in patterns:
        words = pattern.split(".")
        named = {x for x in every if _is_named(words, x, set().intersection if x in given else unwanted.intersection)}
        if not named:
            known = list(dict.fromkeys(".".join(("joints", x.joint, x.key)) for x in every))
            hint = nearest(pattern, known)
            raise UnknownNameError(f"{label}: {show(pattern)} names no entry{hint}; allowed: {_FORMS}")
        chosen |= named
    for entry in chosen:
        damping = robot.joint(entry.joint).damping
        if entry.key == KEYS[1] and damping is not None and not damping.entries:
            form = f"proportional to its stiffness ({damping.share})" if damping.share else "isotropic"
            raise InputError(
                f"{label}: the damping of {entry.joint} is {form}; allowed: entries of a joint whose damping is a"
                " matrix, or has none"
            )
    return tuple(entry for entry in every if entry in chosen)


def _entries(joint: Joint, active: Collection[str]) -> Iterator[Entry]:
    """Yield all entries of a joint's two matrices over some coordinates."""
    for key in KEYS:
        yield from (Entry(joint.name, key, *pair) for pair in PAIRS if set(pair) <= set(active))


def _described(joint: Joint) -> Iterator[Entry]:
    """Yield those that the description gives."""
    for key, element in zip(KEYS, (joint.stiffness, joint.damping), strict=True):
        for name in () if element is None else element.entries:
            one, _, other = name.partition(".")
            yield Entry(joint.name, key, one, other)


def _is_named(words: Sequence[str], entry: Entry, unwanted: Callable[[Iterable[str]], object]) -> bool:
    """Return whether the words of a pattern name an entry, with its coordinates in any order.

    unwanted: those of some coordinates that ``*`` does not stand for.
    """
    for ends in ((entry.one, entry.other), (entry.other, entry.one)):
        path = ("joints", entry.joint, entry.key, *ends)
        if 3 <= len(words) <= len(path) and all(word in (ANY, x) for word, x in zip(words, path, strict=False)):
            open_ends = [end for end, word in zip(ends, (*words[3:], ANY, ANY), strict=False) if word == ANY]
            if not unwanted(component_name(entry.joint, end) for end in open_ends):
                return True
    return False
