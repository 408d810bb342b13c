"""Run-time parameters of a compiled kernel, by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, UnknownNameError
from ..names import nearest_or_all, show
from .arrays import names_in
from .direct import State
from .raw import RawKernel, Setup

ROUND_OFF = 1e-9  # of a matrix scaled by its diagonal, and as many roundings of entries in single precision:
ROUNDINGS = 8.0
SPEEDS, TINY = 4000, 1e-12  # at which damping of bristles is looked at; least of it that counts, N s/m or N m s/rad
FADING = "bristle_damping or fade so low that bristles give no energy back"  # what is allowed of them
SEEN = 0.1  # of a direction's largest share, from which on its coordinates are named


@dataclass(frozen=True)
class Entries:
    """Entries of a symmetric matrix among parameters: the others are 0.

    owner: its name, "joints.joint1.stiffness".  coordinates: of its rows.  slots: of the entries.  places: of the
    entries, as indices of coordinates, row and column.
    """

    owner: str
    coordinates: tuple[str, ...]
    slots: tuple[int, ...]
    places: tuple[tuple[int, int], ...]

    def negative(self, values: Sequence[float], round_off: float) -> list[str]:
        """Return coordinates of a motion that has a negative energy with these values; none where no motion has.

        The matrix is scaled by its diagonal, as units are mixed, and may be negative by this ``round_off`` per row.
        """
        matrix = np.zeros((len(self.coordinates),) * 2)
        for (i, j), value in zip(self.places, values, strict=True):
            matrix[i, j] = matrix[j, i] = value
        sizes = np.sqrt(np.maximum(matrix.diagonal(), 0.0))
        loose = matrix.any(axis=1) & (sizes == 0.0)
        if loose.any():  # what has no stiffness of its own, and what it is coupled to
            coupled = matrix[loose].any(axis=0) | loose
            return [name for name, is_coupled in zip(self.coordinates, coupled, strict=True) if is_coupled]
        held = sizes > 0.0
        scaled = matrix[np.ix_(held, held)] / np.outer(sizes[held], sizes[held])
        if not held.any() or not np.isfinite(scaled).all():
            return [] if not held.any() else list(self.coordinates)
        energies, motions = np.linalg.eigh(scaled)
        if energies[0] >= -round_off * len(scaled):
            return []
        shares = np.abs(motions[:, 0]) / np.abs(motions[:, 0]).max()
        names = [name for name, is_held in zip(self.coordinates, held, strict=True) if is_held]
        return [name for name, share in zip(names, shares, strict=True) if share >= SEEN]


@dataclass(frozen=True)
class Condition:
    """A condition between numbers of a law: their sum with ``factors`` is at least ``least``; ``allowed`` says it.

    Where there are no factors, damping of bristles fades as they slide faster, so that they give no energy back at any
    velocity: ``fades`` has the numbers by their keys.
    """

    factors: Mapping[str, float]
    least: float
    allowed: str
    fades: Mapping[str, str]

    @classmethod
    def of(cls, said: Mapping[str, Any]) -> Condition:
        """Return it from plain values."""
        allowed = said.get("allowed", FADING)
        return cls(said.get("factors", {}), said.get("least", 0.0), allowed, said.get("fades", {}))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its numbers."""
        return (*self.factors, *self.fades.values())

    def holds(self, numbers: Mapping[str, float]) -> bool:
        """Return whether numbers, by their names, satisfy it."""
        if self.fades:
            return _fades({key: numbers[name] for key, name in self.fades.items()})
        return sum(factor * numbers[name] for name, factor in self.factors.items()) >= self.least


def _fades(numbers: Mapping[str, float]) -> bool:
    """Return whether bristle_damping exp(-(v / fade)^2) v is at most 4 times what bristles slide at, at any v."""
    coulomb, damping, fade = (numbers[f"friction.{key}"] for key in ("coulomb", "bristle_damping", "fade"))
    more, bell = numbers.get("friction.static", coulomb) - coulomb, numbers.get("friction.gaussian", 1.0)
    scales = [fade, 4.0 * coulomb / max(damping, TINY)] + [bell] * ("friction.gaussian" in numbers)
    v = np.geomspace(1e-3 * min(scales), 10.0 * max(scales), SPEEDS)
    far, near = (np.exp(-np.minimum((v / scale) ** 2, 700.0)) for scale in (fade, bell))
    return bool((damping * far * v <= 4.0 * (coulomb + more * near)).all())


@dataclass(frozen=True)
class Ranges:
    """Ranges of parameters: the least of some, the most of all, matrices and conditions by the names of their numbers.

    round_off: by which matrices that are scaled by their diagonals may be negative, per row.
    """

    least: Mapping[str, float]
    most: float
    entries: Mapping[str, Entries]
    conditions: Mapping[str, Sequence[Condition]]
    round_off: float


def matrices_among(slots: Mapping[str, int], matrices: Mapping[str, Sequence[str]]) -> dict[str, Entries]:
    """Return the matrices by the names of their entries that are parameters."""
    owners: dict[str, Entries] = {}
    for owner, coordinates in matrices.items():
        pairs = [(i, j) for i in range(len(coordinates)) for j in range(i, len(coordinates))]
        names = {f"{owner}.{coordinates[i]}.{coordinates[j]}": (i, j) for i, j in pairs}
        known = {name: place for name, place in names.items() if name in slots}
        entries = Entries(owner, tuple(coordinates), tuple(slots[name] for name in known), tuple(known.values()))
        owners |= dict.fromkeys(known, entries)
    return owners


def by_number(said: Sequence[Mapping[str, Any]]) -> dict[str, list[Condition]]:
    """Return conditions by the names of their numbers, from plain values."""
    found: dict[str, list[Condition]] = {}
    for one in map(Condition.of, said):
        for name in one.names:
            found.setdefault(name, []).append(one)
    return found


class Parameters(MutableMapping[str, float]):
    """Run-time parameters by name; assigning computes what depends on them alone.

    ``update`` sets several at once. Masses, stiffnesses, dampings, armatures, clearances, free lengths and friction
    forces are at least 0, what is divided by 1e-12, matrices of stiffness and damping stay positive semidefinite, and
    numbers of laws go together as in descriptions: hysteresis and bristles give no energy back.  That an inertia stays
    one that a body can have is up to the caller.

    They can be copied and pickled without the kernel that they are of.

    Attributes:
        state: what calls take: the values, and how they are made.
    """

    _again: tuple[Callable[..., Any], tuple[Any, ...]] | None = None  # see ``of``

    def __init__(self, raw: RawKernel, slots: Mapping[str, int], ranges: Ranges, state: State) -> None:
        self._raw, self._slots, self._ranges, self.state = raw, slots, ranges, state
        self._least, self._most = ranges.least, ranges.most
        together = (*ranges.entries, *ranges.conditions)  # none of these is set alone
        self._alone = {**ranges.least, **dict.fromkeys(together, math.inf)}

    @classmethod
    def of(
        cls,
        raw: RawKernel,
        values: Mapping[str, float],
        least: Mapping[str, float],
        matrices: Mapping[str, Sequence[str]],
        conditions: Sequence[Mapping[str, Any]] = (),
        again: tuple[Callable[..., Any], tuple[Any, ...]] | None = None,
    ) -> Parameters:
        """Make the parameters of a compiled module.

        Args:
            raw: the compiled module.
            values: by name, in the order of the slots.
            least: the least value of those that have one.
            matrices: coordinates of symmetric matrices, by their entries' names in front of these.
            conditions: between numbers of laws, as plain values.
            again: a function and its arguments that make the same kernel in another process; none can be pickled
                without.
        """
        slots = {name: slot for slot, name in enumerate(values)}
        state = State(np.array([*values.values(), *(0.0 for _ in raw.turning)], raw.dtype))
        limits = np.finfo(raw.dtype)
        round_off = max(ROUND_OFF, ROUNDINGS * float(limits.eps))
        ranges = Ranges(least, float(limits.max), matrices_among(slots, matrices), by_number(conditions), round_off)
        made = cls(raw, slots, ranges, state)
        made._again = again
        return made

    def copy(self) -> Parameters:
        """Return the same names and values for the same code; neither sees the other's assignments."""
        other = Parameters(self._raw, self._slots, self._ranges, self.state.copy())
        other._again = self._again
        return other

    __copy__ = copy

    def __deepcopy__(self, memo: dict[int, Any]) -> Parameters:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what makes the same kernel again, and the values: no code, no pointers."""
        if self._again is None:
            raise InputError(
                f"parameters: those of {self._raw.name}, a kernel that was put together by hand, cannot be pickled;"
                " allowed: parameters of kernels of eomgen.build and of generated packages, or dict(parameters)"
            )
        turned = [name for name, x in zip(self._raw.turning, self.state.values[len(self) :], strict=True) if x]
        return _parameters_of, (*self._again, dict(self), turned)

    def turn(self, joints: Collection[str]) -> None:
        """Turn the coordinates of these joints with 3-DOF rotation, and those of no others.

        The axes y, z and x of the joint's frame stand in the place of x, y and z, so that its angles are not singular
        where those of the description are.  That is so for forward_dynamics, forward_dynamics_jacobian,
        inverse_dynamics, mass_matrix, residual_jacobian and external_force; with loops not for inverse_dynamics, but
        for residual, the constraint, its Jacobian and bias, constrained_dynamics, settling and following.  All else
        stays as it is described.  It is for integrations, which choose by ``RawKernel.turning``; ``rollout`` does it
        by itself.

        Raises:
            UnknownNameError: a joint without 3-DOF rotation.
        """
        for name in joints:
            if name not in self._raw.turning:
                raise UnknownNameError(f"joints: {name!r} has no 3-DOF rotation; known: {', '.join(self._raw.turning)}")
        turned = [float(name in joints) for name in self._raw.turning]
        self.state.assign(*(x for k, number in enumerate(turned) for x in (len(self._slots) + k, number)))

    @property
    def setup(self) -> Setup:
        """The values as arrays, and what functions of C read of them; replaced as a whole on assignment."""
        return self.state.setup

    def __getitem__(self, name: str) -> float:
        return float(self.state.values[self._slot(name)])

    def __setitem__(self, name: str, value: float) -> None:
        known = type(value) is float and type(name) is str and name in self._slots
        if known and self._alone.get(name, -self._most) <= value <= self._most:  # as in nearly all assignments
            self.state.assign(self._slots[name], value)
        else:
            self.update({name: value})

    def __delitem__(self, name: str) -> None:
        raise InputError(f"parameters: {name!r} cannot be removed; assign another value")

    def __contains__(self, name: object) -> bool:
        return name in self._slots

    def get(self, name: str, default: Any = None) -> Any:
        """Return the value, or the default where there is no parameter of that name."""
        return self[name] if name in self._slots else default

    def __iter__(self) -> Iterator[str]:
        return iter(self._slots)

    def __len__(self) -> int:
        return len(self._slots)

    def __repr__(self) -> str:
        return f"Parameters({dict(self)})"

    def update(self, *args: Any, **kwargs: float) -> None:
        """Set several parameters at once; all of them, or none if one is refused.

        Raises:
            UnknownNameError: not a run-time parameter of this kernel.
            InputError: not a finite number, a whole one that the dtype cannot hold exactly, or negative where that
                cannot be; a matrix of stiffness or damping would not be positive semidefinite; or numbers of a law do
                not go together.
        """
        wanted: list[float] = []
        try:
            values = dict(*args, **kwargs)
        except (TypeError, ValueError):
            raise InputError(f"parameters: {show(args[0])}; allowed: a mapping from names to numbers") from None
        for name, value in values.items():
            slot = self._slot(name)
            held = self._held(name, value)
            least = self._least.get(name)
            if least is not None and value < least:
                wrong = "too small" if least > 0.0 else "negative"
                raise InputError(f"parameters: {name} = {show(value)} is {wrong}; at least {least:g} is allowed")
            wanted += (slot, held)
        held_by_slot = dict(zip(map(int, wanted[::2]), wanted[1::2], strict=True))
        self._refuse_indefinite(values, held_by_slot)
        self._refuse_conflict(values, held_by_slot)
        if wanted:
            self.state.assign(*wanted)

    def _held(self, name: str, value: Any) -> float:
        """Return the number as the kernel's dtype has it, of whole numbers without rounding."""
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            raise InputError(f"parameters: {name} = {show(value)} is not a number")
        dtype = self._raw.dtype
        if isinstance(value, np.generic) and not isinstance(value, np.longdouble):
            value = value.item()
        if not abs(value) < math.inf:
            raise InputError(f"parameters: {name} = {show(value)} is not finite")
        if abs(value) > self._most:
            raise InputError(
                f"parameters: {name} = {show(value)} is beyond {dtype}; at most {self._most:.3g} is allowed"
            )
        held = float(dtype.type(value))
        rounded = held if isinstance(value, int) else float(value)
        if rounded != value:
            raise InputError(f"parameters: {name} = {show(value)} is a number that {dtype} cannot hold exactly")
        return held

    def _refuse_indefinite(self, values: Mapping[str, Any], held: Mapping[int, float]) -> None:
        """Refuse entries by which a matrix has a direction of negative energy; as a whole, with the others as they are.

        Args:
            values: new ones by name.  held: the same by slot, as the dtype has them.
        """
        entries_of = self._ranges.entries
        touched = {entries.owner: entries for name in values if (entries := entries_of.get(name))}
        for owner, entries in touched.items():
            numbers = [held.get(slot, float(self.state.values[slot])) for slot in entries.slots]
            moving = entries.negative(numbers, self._ranges.round_off)
            if moving:
                changed = ", ".join(f"{x} = {show(y)}" for x, y in values.items() if entries_of.get(x) is entries)
                raise InputError(
                    f"parameters: {changed}: {owner} would have a negative energy where {' and '.join(moving)} move;"
                    " allowed: entries of a positive semidefinite matrix (``update`` changes several at once)"
                )

    def _refuse_conflict(self, values: Mapping[str, Any], held: Mapping[int, float]) -> None:
        """Refuse numbers of a law that do not go together, with the others as they are; arguments as above."""
        touched = {id(one): one for name in values for one in self._ranges.conditions.get(name, ())}
        for one in touched.values():
            numbers = {x: held.get(self._slots[x], float(self.state.values[self._slots[x]])) for x in one.names}
            if not one.holds(numbers):
                changed = ", ".join(f"{x} = {show(y)}" for x, y in values.items() if x in numbers)
                beside = ", ".join(f"{x} is {numbers[x]:g}" for x in one.names if x not in values)
                raise InputError(
                    f"parameters: {changed}{beside and f', where {beside}'}; allowed: {one.allowed} (``update`` changes"
                    " several at once)"
                )

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._slots)

    def _slot(self, name: str) -> int:
        try:
            return self._slots[name]
        except (KeyError, TypeError):
            pass
        raise UnknownNameError(
            f"parameters: {name!r} is not a run-time parameter of {self._raw.name}"
            f"{nearest_or_all(str(name), self._slots)}; list other numbers of the description under `tunable`"
        )


def kernel_of(
    make: Callable[..., Any], args: tuple[Any, ...], values: Mapping[str, float], turned: Sequence[str]
) -> Any:
    """Make a kernel again, whose parameters have the values and the turned joints of a pickle."""
    kernel = make(*args)
    changed = {name: value for name, value in values.items() if kernel.parameters[name] != value}
    if changed:
        kernel.parameters.update(changed)
    kernel.parameters.turn(turned)
    return kernel


def _parameters_of(*pickled: Any) -> Parameters:
    """Return the parameters of a kernel that is made again."""
    made: Parameters = kernel_of(*pickled).parameters
    return made


def parameter_slots(parameters: Parameters, names: Sequence[str]) -> list[int]:
    """Return places of parameters by their names.

    Raises:
        InputError: a text instead of a sequence of names, or a name that stands twice.
        UnknownNameError: not a run-time parameter.
    """
    names = names_in("parameters", names)
    known = {name: slot for slot, name in enumerate(parameters)}
    for name in names:
        if name not in known:
            raise UnknownNameError(f"parameters: {name!r} is unknown{nearest_or_all(str(name), known)}")
    if len(set(names)) < len(names):
        raise InputError(f"parameters: {', '.join(names)}; allowed: every name once")
    return [known[name] for name in names]
