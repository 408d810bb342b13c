"""Files of links that bend: arrays of NumPy (.npz), SI units, axes of the link's frame.

Constants: ``H00`` (4, 4), ``H0`` (m, 4, 3), ``P`` (m, m, 3, 3), ``K`` (m, m), perhaps ``D`` (m, m) and ``Q``
(m, m, 4, 3), see ``constants``; ``interface_names`` (I), ``interface_places`` (I, 3), ``interface_Phi`` (I, 6, m),
perhaps ``interface_Psi`` (I, 3, m, m), and ``velocity_terms``, a text: how these were found where they are not exact.

Modes of nodes: ``nodes`` (N, 3), ``mass`` (N), ``Phi`` (N, 6, m) with translations and rotations of each node by each
mode, or (N, 3, m), ``K``, perhaps ``inertia`` (N, 3, 3) of each node about itself, ``D``, ``M`` (m, m), the masses of
modes to compare with, ``interface_names`` (I) and ``interface_nodes`` (I), numbers of nodes from 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import InputError
from ..files import check_ending, write_atomically
from ..identifiers import is_identifier, plain_path
from ..limits import LARGEST, MOST_INTERFACES, MOST_MODES, MOST_SHAPE_NUMBERS
from ..names import listed, show
from ..npz import read_npz
from ..robot.value import ROOT, Node
from .bending_body import BendingBody
from .consistency import clamped_conflict, constants_conflict, is_free
from .constants import Constants, as_tuples, constants_of_masses
from .mass_integrals import EXACT, MEAN, REDUCED

ENDING = ".npz"
_CONSTANTS = (
    "H00",
    "H0",
    "P",
    "K",
    "D",
    "Q",
    "interface_names",
    "interface_places",
    "interface_Phi",
    "interface_Psi",
    "velocity_terms",
)
_NODAL = ("nodes", "mass", "inertia", "Phi", "K", "D", "M", "interface_names", "interface_nodes")
_STILL = 1e-6  # of the largest entry of Phi: what a clamped node moves by at most
_SAME_MASSES = 0.02  # that modal masses may be off those of the nodes' masses: lumping


def body_of_arrays(path: Path | str, arrays: Mapping[str, NDArray[Any]]) -> BendingBody:
    """Return the link that arrays of a file are, of constants or of modes of nodes.

    Raises:
        InputError: an array is missing, of another shape or not finite, or no body can have these numbers; the message
            has the file, the array, the place and what is allowed.
    """
    file = _File(plain_path(path), arrays)
    if "H0" in file.arrays or "H00" in file.arrays:
        file.refuse_others(_CONSTANTS)
        return _of_constants(file)
    if "Phi" in file.arrays or "nodes" in file.arrays:
        file.refuse_others(_NODAL)
        return _of_nodes(file)
    known = (
        f"constants ({', '.join(_CONSTANTS[:4])}, ...), modes of nodes ({', '.join(_NODAL[:5])}, ...) or finite "
        "elements (nodes, dofs, K_data, M_data, ...)"
    )
    raise InputError(f"{file.path}: has the arrays {listed(sorted(file.arrays)) or 'none'}; allowed: {known}")


def write_constants(path: Path | str, body: BendingBody) -> Path:
    """Write the constants of a link that bends to a .npz, and return its path."""
    target, modes = check_ending(path, ENDING), body.modes
    arrays: dict[str, Any] = {"H00": body.H00, "H0": modes.H0, "P": modes.P, "K": modes.K, "D": modes.D}
    if modes.Q is not None:
        arrays["Q"] = modes.Q
    m, nodes = modes.count, modes.nodes
    arrays |= {
        "interface_names": np.array([node.name for node in nodes], dtype=str),
        "interface_places": np.array([node.place for node in nodes], dtype=float).reshape(-1, 3),
        "interface_Phi": np.array([node.Phi for node in nodes], dtype=float).reshape(-1, 6, m),
    }
    if any(node.Psi is not None for node in nodes):
        second = [np.zeros((3, m, m)) if node.Psi is None else np.array(node.Psi) for node in nodes]
        arrays["interface_Psi"] = np.array(second)
    if body.velocity_terms != EXACT:
        arrays["velocity_terms"] = np.array(body.velocity_terms)
    made = {key: np.asarray(value) for key, value in arrays.items()}
    return write_atomically(
        target,
        lambda stream: np.savez_compressed(stream, **made),  # type: ignore[arg-type]
        read=lambda place: body_of_arrays(place, read_npz(place)),
    )


@dataclass(frozen=True)
class _File:
    """Arrays of a file, and refusals with its path."""

    path: Path | str
    arrays: Mapping[str, NDArray[Any]]

    def fail(self, key: str, message: str) -> NoReturn:
        raise InputError(f"{self.path}: array {show(key)}: {message}")

    def refuse_others(self, known: Sequence[str]) -> None:
        """Refuse arrays that are not looked at."""
        for key in self.arrays:
            if key not in known:
                self.fail(key, f"it is unknown; allowed: {', '.join(known)}")

    def numbers(self, key: str, *shape: int | str, default: bool = False) -> Array | None:
        """Return an array of finite numbers; None where it is not there and need not be.

        Args:
            key: name of the array.
            *shape: lengths; texts stand for any length.
            default: whether it may be missing.
        """
        array = self.arrays.get(key)
        said = f"an array of {' x '.join(map(str, shape))} numbers"
        if array is None:
            if default:
                return None
            self.fail(key, f"it is missing; allowed: {said}")
        fits = array.ndim == len(shape) and all(
            isinstance(want, str) or have == want for have, want in zip(array.shape, shape, strict=True)
        )
        if array.dtype.kind not in "iuf" or not fits:
            self.fail(key, f"got shape {array.shape} of {array.dtype}; allowed: {said}")
        with np.errstate(over="ignore"):  # of longer floats; what becomes infinite is refused
            values = np.asarray(array, dtype=float)
        wrong = ~(np.abs(values) <= LARGEST)
        if wrong.any():
            place = tuple(int(i) for i in np.argwhere(wrong)[0])
            self.fail(key, f"got {values[place]} at {list(place)}; allowed: finite numbers up to {LARGEST:g}")
        return values

    def needed(self, key: str, *shape: int | str) -> Array:
        """Return an array of finite numbers that has to be there."""
        values = self.numbers(key, *shape)
        assert values is not None
        return values

    def square(self, key: str, count: int) -> Array:
        """Return the matrix of that name, zeros where it is not there."""
        values = self.numbers(key, count, count, default=True)
        return np.zeros((count, count)) if values is None else values

    def stiffness(self) -> Array:
        """Return K, (m, m), which says how many modes there are."""
        K = self.needed("K", "m", "m")
        if K.shape[0] != K.shape[1] or not 1 <= len(K) <= MOST_MODES:
            self.fail("K", f"got shape {K.shape}; allowed: a square matrix of 1 to {MOST_MODES} rows, one of each mode")
        return K

    def names(self) -> list[str]:
        """Return the names of the interfaces."""
        array = self.arrays.get("interface_names")
        if array is None:
            return []
        if array.dtype.kind != "U" or array.ndim != 1:
            self.fail("interface_names", f"got shape {array.shape} of {array.dtype}; allowed: a list of texts")
        if len(array) > MOST_INTERFACES:
            self.fail("interface_names", f"has {len(array)} names; allowed: up to {MOST_INTERFACES}")
        names = [str(name) for name in array]
        for name in names:
            if not is_identifier(name) or name == ROOT:
                self.fail("interface_names", f"got {show(name)}; allowed: an identifier other than {ROOT}")
            if names.count(name) > 1:
                self.fail("interface_names", f"{show(name)} is there twice; allowed: unique names")
        shapes = sum(self.arrays[key].size for key in ("interface_Phi", "interface_Psi") if key in self.arrays)
        if shapes > MOST_SHAPE_NUMBERS:
            got = f"with interface_Phi it has {shapes} numbers"
            self.fail("interface_Psi", f"{got}; allowed: up to {MOST_SHAPE_NUMBERS}, fewer modes or interfaces")
        return names

    def velocity_terms(self) -> str:
        """Return how velocity terms were found; EXACT where nothing is said."""
        array = self.arrays.get("velocity_terms")
        if array is None:
            return EXACT
        if array.dtype.kind != "U" or array.ndim or str(array) not in (EXACT, MEAN, REDUCED):
            self.fail("velocity_terms", f"got {show(array.tolist())}; allowed: {EXACT}, {MEAN}, or {REDUCED}")
        return str(array)


def _of_constants(file: _File) -> BendingBody:
    K = file.stiffness()
    m, names = len(K), file.names()
    made = Constants(
        file.needed("H00", 4, 4),
        file.needed("H0", m, 4, 3),
        file.needed("P", m, m, 3, 3),
        file.numbers("Q", m, m, 4, 3, default=True),
    )
    places, Phi = file.needed("interface_places", len(names), 3), file.needed("interface_Phi", len(names), 6, m)
    Psi = file.numbers("interface_Psi", len(names), 3, m, m, default=True)
    nodes = [
        Node(name, as_tuples(place), as_tuples(phi), None if Psi is None or not Psi[i].any() else as_tuples(Psi[i]))
        for i, (name, place, phi) in enumerate(zip(names, places, Phi, strict=True))
    ]
    return _checked(file, made, K, nodes, file.velocity_terms())


def _of_nodes(file: _File) -> BendingBody:
    K = file.stiffness()
    m, names = len(K), file.names()
    places = file.needed("nodes", "N", 3)
    count = len(places)
    mass, Phi = file.needed("mass", count), file.needed("Phi", count, "6 or 3", m)
    if Phi.shape[1] not in (3, 6):
        file.fail("Phi", f"got shape {Phi.shape}; allowed: {count} x 6 x {m} or {count} x 3 x {m} numbers")
    if mass.size and mass.min() < 0.0:
        node = int(mass.argmin())
        file.fail("mass", f"got {mass[node]:g} of node {node}; allowed: numbers that are at least 0")
    rotations = Phi[:, 3:] if Phi.shape[1] == 6 else np.zeros((count, 3, m))
    made = constants_of_masses(mass, places, _moments(file, count), Phi[:, :3], rotations)
    if not made.H00[3, 3] > 0.0:
        file.fail("mass", "all masses are 0; allowed: a link with a mass")
    _check_masses(file, made)
    if not is_free(made):
        _check_root(file, Phi, places)
    which = file.arrays.get("interface_nodes")
    if names and Phi.shape[1] == 3:
        file.fail("Phi", f"interfaces need rotations; allowed: {count} x 6 x {m} numbers")
    if which is None or which.dtype.kind not in "iu" or which.shape != (len(names),):
        if names or which is not None:
            file.fail("interface_nodes", f"allowed: {len(names)} numbers of nodes, one of each interface")
        which = np.zeros(0, dtype=int)
    for name, node in zip(names, which, strict=True):
        if not 0 <= node < count:
            file.fail("interface_nodes", f"got {node} of {show(name)}; allowed: numbers of nodes, 0 to {count - 1}")
    nodes = [Node(name, as_tuples(places[node]), as_tuples(Phi[node])) for name, node in zip(names, which, strict=True)]
    return _checked(file, made, K, nodes)


def _moments(file: _File, count: int) -> Array:
    """Return second moments of mass of the nodes about themselves, (N, 3, 3), by their inertia tensors."""
    inertia = file.numbers("inertia", count, 3, 3, default=True)
    if inertia is None:
        return np.zeros((count, 3, 3))
    off = np.abs(inertia - inertia.transpose(0, 2, 1)).max(axis=(1, 2))
    sizes = np.abs(inertia).max(axis=(1, 2))
    if np.any(off > 1e-8 * sizes):
        node = int(np.argmax(off - 1e-8 * sizes))
        file.fail("inertia", f"that of node {node} is off its transpose by {off[node]:g}; allowed: symmetric tensors")
    moments = np.trace(inertia, axis1=1, axis2=2)[:, None, None] / 2.0 * np.eye(3) - inertia
    least = np.linalg.eigvalsh(moments)[:, 0]
    if np.any(least < -1e-8 * sizes):
        node = int(np.argmin(least + 1e-8 * sizes))
        more = f"{-2.0 * least[node]:g}"
        text = f"that of node {node} has a principal moment greater than the sum of the others, by {more}"
        file.fail("inertia", f"{text}; allowed: tensors that a body can have")
    return np.asarray(moments)


def _check_masses(file: _File, made: Constants) -> None:
    """Refuse modal masses that are not those of the nodes' masses."""
    given = file.numbers("M", made.count, made.count, default=True)
    if given is None:
        return
    scale = np.sqrt(np.clip(np.diag(made.masses), np.finfo(float).tiny, None))
    off = np.abs(given - made.masses) / np.outer(scale, scale)
    k, j = (int(i) for i in np.unravel_index(int(np.argmax(off)), off.shape))
    if off[k, j] > _SAME_MASSES:
        text = f"got {given[k, j]:g} at ({k + 1}, {j + 1}), where mass and Phi give {made.masses[k, j]:g}"
        file.fail("M", f"{text}; allowed: within {_SAME_MASSES:g} of the modes' masses")


def _check_root(file: _File, Phi: Array, places: Array) -> None:
    """Refuse modes that move all nodes, and are not those of a free link: nothing is clamped."""
    motion = np.abs(Phi).max(axis=(1, 2))
    still = motion <= _STILL * motion.max()
    enough = 1 if Phi.shape[1] == 6 else 3
    if np.count_nonzero(still) < enough:
        node = int(np.argmin(np.where(still, np.inf, motion)))
        where = ", ".join(f"{x:g}" for x in places[node])
        nodes = "a node" if enough == 1 else "three nodes"
        text = f"the modes move node {node} at ({where}), which moves least, by {motion[node]:.3g}"
        file.fail("Phi", f"{text}; allowed: {nodes} of the root where they are 0, or a free link's modes in mean axes")


def _checked(file: _File, made: Constants, K: Array, nodes: Sequence[Node], velocity_terms: str = EXACT) -> BendingBody:
    """Return the body; refuses what no link can have."""
    D = file.square("D", len(K))
    conflict = constants_conflict(made, K, D)
    if conflict is not None:
        file.fail(*conflict)
    free = is_free(made)
    moved = None if free else clamped_conflict(made, K)
    if moved is not None:
        file.fail("Phi" if "Phi" in file.arrays else "P", moved)
    P = (made.P + made.P.transpose(1, 0, 3, 2)) / 2.0
    Q = None if made.Q is None else (made.Q + made.Q.transpose(1, 0, 2, 3)) / 2.0
    exact = Constants(made.H00, made.H0, P, Q)
    return BendingBody(made.H00, exact.link_modes((K + K.T) / 2.0, (D + D.T) / 2.0, nodes), free, velocity_terms)
