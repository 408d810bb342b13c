"""Entries of stiffness and damping matrices of joints, loop joints and bushings that are looked for.

An entry k between two coordinates resists the one by k times the other's deviation (or rate, of damping), and the other
by k times the one's.  The entry of a coordinate with itself is the whole stiffness or damping there: that of the
coordinate's own table is in it, so that what is found is positive semidefinite where the joint is.  The six numbers of
a bushing are the diagonal of its matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...errors import InputError, UnknownNameError
from ...kernel.complete import Kernel
from ...names import component_name, nearest, parameter_name, show
from ...robot.elements.joint_damping import JointDamping, lag_of
from ...robot.elements.joint_element import JointElement, MatrixElement
from ...robot.elements.matrices import PAIRS, entry_name
from ...robot.parameter_names import CUT_MOTIONS, CUT_STIFFNESSES, CUTS, JOINTS, MOTIONS, STIFFNESSES
from ...robot.value import COORDINATES, Robot
from ...state.elements import Numbers, element_numbers
from .frame_pairs import bushings_of
from .result import KEYS

ANY = "*"
OF_JOINTS, OF_LOOPS, OF_BUSHINGS = OWNERS = ("joints", "loops", "bushings")  # of matrices, as names of parameters begin
_FAMILIES = {
    OF_JOINTS: dict(zip(KEYS, (STIFFNESSES, MOTIONS), strict=True)),
    OF_LOOPS: dict(zip(KEYS, (CUT_STIFFNESSES, CUT_MOTIONS), strict=True)),
}
_FORMS = (
    "joints.JOINT.stiffness (or damping), of all its coordinates, or joints.JOINT.stiffness.x.beta; loops.LOOP and"
    " bushings.BUSHING alike; * for any word"
)
_NOT_LINEAR = ("clearance", "stiffness_negative")  # laws that use a coordinate's stiffness otherwise than as a spring


@dataclass(frozen=True)
class Entry:
    """An entry of a matrix: "stiffness" or "damping" between the coordinates one and other, "x" and "beta".

    joint: name of the joint, loop joint or bushing.  owner: which of ``OWNERS`` that is one of.
    """

    joint: str
    key: str
    one: str
    other: str
    owner: str = OF_JOINTS

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
        return parameter_name(self.owner, self.joint, self.key, self.one, self.other)


@dataclass(frozen=True)
class MatrixNumbers:
    """Numbers of matrices, and of the tables beside them, as a kernel has them now.

    matrices: by owner and key, then joint and entry.  tables: of coordinates' laws, by owner, then by their names.
    """

    matrices: Mapping[tuple[str, str], Numbers]
    tables: Mapping[str, Numbers]

    @classmethod
    def of(cls, kernel: Kernel) -> MatrixNumbers:
        """Read them of a kernel as its parameters are now."""
        families = [(owner, key, family) for owner, below in _FAMILIES.items() for key, family in below.items()]
        matrices = {(owner, key): element_numbers(kernel, family) for owner, key, family in families}
        bushings = element_numbers(kernel, OF_BUSHINGS)
        for key in KEYS:
            matrices[OF_BUSHINGS, key] = {name: dict(_below(key, numbers)) for name, numbers in bushings.items()}
        tables = {OF_JOINTS: element_numbers(kernel, JOINTS), OF_LOOPS: element_numbers(kernel, CUTS)}
        return cls(matrices, tables)

    def entries(self, owner: str, joint: str, key: str) -> dict[str, float]:
        """Return the numbers of a matrix by their names, without those of tables."""
        return self.matrices[owner, key].get(joint, {})

    def described(self, entry: Entry) -> float:
        """Return the value of an entry, with that of a coordinate's table that it takes in."""
        own = self.entries(entry.owner, entry.joint, entry.key).get(entry.entry, 0.0)
        return own + self.tables[entry.owner][entry.ends[0]][entry.key] if self.takes_in(entry) else own

    def takes_in(self, entry: Entry) -> bool:
        """Return whether the coordinate's own table has such a number, linear, which an entry takes in."""
        law = self.tables.get(entry.owner, {}).get(entry.ends[0], {})
        linear = entry.key != KEYS[0] or not any(law.get(key) for key in _NOT_LINEAR)
        return len(entry.ends) == 1 and bool(law.get(entry.key)) and linear

    def lag(self, entry: Entry) -> float:
        """Return by how much a stiffness's rates count beside its deviations, s: of damping proportional to it."""
        if entry.key != KEYS[0]:
            return 0.0
        return float(lag_of(self.entries(entry.owner, entry.joint, KEYS[1])))


def _below(key: str, numbers: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a bushing below a key, its six numbers by the names of entries of the diagonal."""
    for name, value in numbers.items():
        table, _, entry = name.partition(".")
        if table == key:
            yield (entry_name(entry, entry) if entry in COORDINATES else entry), value


def entries_sought(
    robot: Robot, patterns: Sequence[str] | None, label: str = "matrices", *, rigid: bool = False
) -> tuple[Entry, ...]:
    """Return the entries that patterns name, in the order of the joints; those that are described where it is None.

    A pattern is the name of a parameter, ``joints.JOINT.stiffness.x.beta``, in which ``*`` stands for any word; what is
    left out at its end may be anything.  Loop joints (``loops``) and bushings (``bushings``) have such names, too.
    Principal coordinates are named by their word alone, or described.

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
    places = list(_places(robot))
    given = {entry for place in places for entry in place.described()}
    if patterns is None:
        return tuple(x for place in places for x in place.entries(place.coordinates) if x in given)
    if not patterns:
        return ()
    every = [x for y in places for x in y.entries(COORDINATES if rigid and y.owner == OF_JOINTS else y.coordinates)]
    unwanted = {component_name(x.name, x.principal) for x in robot.joints if x.principal}
    for joint in robot.joints if rigid else ():
        if any(component_name(joint.name, name) not in unwanted for name in joint.coordinates):
            unwanted |= {component_name(joint.name, x) for x in COORDINATES if x not in joint.coordinates}
    chosen: set[Entry] = set()
    for pattern in patterns:
        words = pattern.split(".")
        named = {
            x
            for x in every
            if _is_named(words, x, set().intersection if x in given or x.owner != OF_JOINTS else unwanted.intersection)
        }
        if not named:
            known = list(dict.fromkeys(".".join((x.owner, x.joint, x.key)) for x in every))
            hint = nearest(pattern, known)
            raise UnknownNameError(f"{label}: {show(pattern)} names no entry{hint}; allowed: {_FORMS}")
        chosen |= named
    for place in places:
        damping = place.elements.get(KEYS[1])
        if isinstance(damping, JointDamping) and not damping.entries:
            form = f"proportional to its stiffness ({damping.share})" if damping.share else "isotropic"
            if any(place.has(entry) and entry.key == KEYS[1] for entry in chosen):
                raise InputError(
                    f"{label}: the damping of {place.name} is {form}; allowed: entries of a joint whose damping is a"
                    " matrix, or has none"
                )
    return tuple(entry for entry in every if entry in chosen)


@dataclass(frozen=True)
class _Place:
    """A joint, loop joint or bushing that may have matrices: coordinates that these may be between, and elements."""

    owner: str
    name: str
    coordinates: tuple[str, ...]
    elements: Mapping[str, JointElement]

    def entries(self, active: Collection[str]) -> Iterator[Entry]:
        """Yield all entries of its two matrices over some coordinates."""
        for key in KEYS:
            yield from (Entry(self.name, key, *pair, self.owner) for pair in PAIRS if set(pair) <= set(active))

    def described(self) -> Iterator[Entry]:
        """Yield those that the description gives."""
        for key, element in self.elements.items():
            for name in element.entries if isinstance(element, MatrixElement) and key in KEYS else ():
                one, _, other = name.partition(".")
                yield Entry(self.name, key, one, other, self.owner)

    def has(self, entry: Entry) -> bool:
        """Return whether an entry is one of its matrices."""
        return (self.owner, self.name) == (entry.owner, entry.joint)


def _places(robot: Robot) -> Iterator[_Place]:
    """Yield all joints, loop joints and bushings of a robot."""
    for owner, joints in ((OF_JOINTS, robot.joints), (OF_LOOPS, robot.loops)):
        yield from (_Place(owner, x.name, tuple(x.coordinates), x.elements) for x in joints)
    yield from (_Place(OF_BUSHINGS, x.name, COORDINATES, x.matrices) for x in bushings_of(robot))


def _is_named(words: Sequence[str], entry: Entry, unwanted: Callable[[Iterable[str]], object]) -> bool:
    """Return whether the words of a pattern name an entry, with its coordinates in any order.

    unwanted: those of some coordinates that ``*`` does not stand for.
    """
    for ends in ((entry.one, entry.other), (entry.other, entry.one)):
        path = (entry.owner, entry.joint, entry.key, *ends)
        if 3 <= len(words) <= len(path) and all(word in (ANY, x) for word, x in zip(words, path, strict=False)):
            open_ends = [end for end, word in zip(ends, (*words[3:], ANY, ANY), strict=False) if word == ANY]
            if not unwanted(component_name(entry.joint, end) for end in open_ends):
                return True
    return False
