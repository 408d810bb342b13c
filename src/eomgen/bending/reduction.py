"""Craig-Bampton modes of a link's finite elements, and the constants of its equations of motion.

A clamped link has six static shapes for each interface (unit displacements of it, all else free of forces) and
fixed-interface modes: R. R. Craig, M. C. C. Bampton, "Coupling of Substructures for Dynamic Analyses", AIAA Journal
6(7), 1968; without fixed-interface modes this is the static condensation of R. J. Guyan, "Reduction of Stiffness and
Mass Matrices", AIAA Journal 3(2), 1965.  A free link has inertia-relief shapes of forces at each interface, and its
free-free modes, all of them without momentum of the rigid-body motions (mean axes).

The modes that are returned are those of the reduced model by itself: K is diagonal, modal masses are 1 kg, so that each
mode has a frequency, and statics at interfaces are those of all finite elements all the same.

Source of stiffening by rotation: the geometric stiffness matrix of the stresses under 12 loads of the body and three of
each interface, all for a link that is clamped.  Load "body.j.i" is the force of inertia of a unit acceleration along i
times coordinate j (1: one), that is -rho_j e_i per mass; load "tip.i" is a force of -1 N along i at the interface tip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Index, independent_columns
from ..errors import InputError
from ..optional import optional_import
from ..progress import StageReport, no_report
from .checks import check_matrices, check_pivots, check_rank, check_responses, rigid_motions
from .constants import skew
from .finite_elements import DIRECTIONS, FiniteElements, Interface, checked
from .mass_integrals import integrals
from .reduced_link import ReducedLink

DENSE = 400  # unknowns up to which eigenvalues are those of full matrices
MOST_DENSE = 3000
MOST_PIVOTS = 20_000  # unknowns: SciPy copies factors whose pivots are looked at, which doubles their memory
NEGLIGIBLE = 1e-11  # of the greatest entry of its kind: round-off, which becomes an exact 0
INDEPENDENT = 1e-12  # least eigenvalue of scaled matrices of shapes that do not depend on one another
NO_MASS = 1e-14  # of the greatest 1 / w^2: round-off of coordinates without mass
_ADVICE = "a set of nodes that are not in one line, or a node with rotations"


def reduce(elements: FiniteElements, *, craig_bampton: bool = False, report: StageReport = no_report) -> ReducedLink:
    """Reduce a link's finite elements to modes.

    Args:
        elements: of the link.
        craig_bampton: whether modes stay what they are by construction, displacements of the interfaces (m and rad) and
            then fixed-interface modes; else their combinations with frequencies of their own.
        report: called with what is done next.

    Raises:
        InputError: finite elements are not those of a link; the message has the number and the place.
    """
    checked(elements)
    with optional_import("SciPy", "reductions of finite elements need"):
        import scipy.sparse.linalg as _  # noqa: F401
    is_free = len(elements.root) == 0
    for given, what in ((craig_bampton, "Craig-Bampton modes"), (bool(elements.stress), "load cases of stress")):
        if given and is_free:
            raise InputError(f"root: has no node, and {what} are asked for; allowed: those of a clamped link")
    report("checking M and K")
    check_matrices(elements)
    basis = _Basis.of(elements)
    report("factorising K")
    solve = _free(basis) if is_free else _clamped(basis)
    static = _static_shapes(elements, basis, solve)
    report("computing modes")
    V = np.hstack([static, _eigenmodes(elements, basis, solve, static)])
    K, masses = V.T @ (basis.K @ V), V.T @ (basis.M @ V)
    turn, squares = _own_modes(0.5 * (K + K.T), 0.5 * (masses + masses.T))
    Phi = np.eye(static.shape[1], V.shape[1])
    if craig_bampton:
        parts = static.shape[1]
        K = 0.5 * (K + K.T)
        K[:parts, parts:] = K[parts:, :parts] = 0.0  # displacements of interfaces do no work on modes that fix them
        K[parts:, parts:] = np.diag(K.diagonal()[parts:])
    else:
        V, K = V @ turn, np.diag(squares)
        Phi = basis.A @ V
    report("integrating masses")
    return _constants(elements, basis.T @ V, Phi, K, np.sqrt(squares) / (2.0 * np.pi))


@dataclass(frozen=True)
class _Basis:
    """Unknowns of a link: coordinates that are in no rigid set, then six of each rigid interface.

    T: sparse, coordinates of all finite elements by unknowns.  K, M: of unknowns.  A: sparse, displacements of
    interfaces by unknowns, (6 I, size).  R: rigid-body motions of unknowns.  names: what a row is called.
    """

    T: Any
    K: Any
    M: Any
    A: Any
    R: Array
    names: Callable[[int], str]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.K.shape[0])

    @staticmethod
    def of(elements: FiniteElements) -> _Basis:
        from scipy.sparse import block_array, csc_array, csr_array

        n, rows = len(elements.dofs), elements.by_node()
        rigid = [interface for interface in elements.interfaces if interface.kind != "rbe3"]
        held = np.zeros(n, dtype=bool)
        sets = {interface.name: _rows_of(rows, interface.nodes) for interface in rigid}
        if len(elements.root):
            root = _rows_of(rows, elements.root)
            _check_set(elements, "root", elements.root, root)
            held[root] = True
        for mine in sets.values():
            held[mine] = True
        kept = np.flatnonzero(~held)
        columns = [csr_array((np.ones(len(kept)), (kept, np.arange(len(kept)))), shape=(n, len(kept)))]
        for interface in rigid:
            mine = sets[interface.name]
            motions = rigid_motions(elements.nodes, elements.dofs[mine], interface.place)
            _check_set(elements, f"interface {interface.name}", interface.nodes, mine)
            places = (np.repeat(mine, 6), np.tile(np.arange(6), len(mine)))
            columns.append(csr_array((motions.ravel(), places), shape=(n, 6)))
        T = csr_array(block_array([columns]))
        size = T.shape[1]
        A = [_rows_of_interface(elements, interface, rows, rigid, len(kept), T) for interface in elements.interfaces]
        K, M = csc_array(T.T @ elements.K @ T), csc_array(T.T @ elements.M @ T)
        R = np.zeros((size, 6))
        R[: len(kept)] = rigid_motions(elements.nodes, elements.dofs[kept])
        six = np.array([[0, d] for d in range(6)])
        for k, interface in enumerate(rigid):
            start = len(kept) + 6 * k
            R[start : start + 6] = rigid_motions(interface.place[None], six)

        def name(row: int) -> str:
            if row < len(kept):
                return elements.row_name(int(kept[row]))
            k, d = divmod(row - len(kept), 6)
            return f"interface {rigid[k].name}, {DIRECTIONS[d]}"

        return _Basis(T, K, M, csr_array(block_array([[a] for a in A])) if A else csr_array((0, size)), R, name)


def _check_set(elements: FiniteElements, name: str, nodes: Index, rows: Index) -> None:
    """Refuse a set of nodes whose rows of the matrices leave a rigid-body motion open."""
    check_rank(name, rigid_motions(elements.nodes, elements.dofs[rows], elements.nodes[nodes].mean(axis=0)), _ADVICE)


def _rows_of(rows: Index, nodes: Index) -> Index:
    """Return the rows of all coordinates of nodes."""
    mine = rows[nodes].ravel()
    return mine[mine >= 0]


def _rows_of_interface(
    elements: FiniteElements, interface: Interface, rows: Index, rigid: list[Interface], kept: int, T: Any
) -> Any:
    """Return an interface's displacements by unknowns, sparse, (6, size)."""
    from scipy.sparse import csr_array

    size = T.shape[1]
    if interface.kind != "rbe3":
        start = kept + 6 * rigid.index(interface)
        return csr_array((np.ones(6), (np.arange(6), start + np.arange(6))), shape=(6, size))
    mine = rows[interface.nodes, :3].ravel()
    middle = elements.nodes[interface.nodes].mean(axis=0)
    motions = rigid_motions(elements.nodes, elements.dofs[mine], middle)
    weights = np.ones(len(interface.nodes)) if interface.weights is None else interface.weights
    roots = np.sqrt(np.repeat(weights / weights.max(), 3))[:, None]
    check_rank(f"interface {interface.name}", roots * motions, _ADVICE)
    shift = np.eye(6)  # from the middle of the set to the interface's place
    shift[:3, 3:] = -skew(interface.place - middle)
    mean = shift @ np.linalg.pinv(roots * motions) * roots.T
    places = (np.repeat(np.arange(6), len(mine)), np.tile(mine, 6))
    return csr_array(csr_array((mean.ravel(), places), shape=(6, T.shape[0])) @ T)


def _factors(K: Any, names: Callable[[int], str]) -> Any:
    """Factorise a symmetric, positive definite matrix without exchanges of rows."""
    from scipy.sparse.linalg import splu

    if not K.shape[0]:
        raise InputError("root: with rigid interfaces it has all nodes; allowed: a link with nodes in neither")
    try:
        options = {"SymmetricMode": True}
        factors = splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:  # exactly singular
        raise InputError(
            "K, clamped: is singular; allowed: a positive definite matrix, of a link in one piece without mechanisms"
        ) from None
    except MemoryError:
        raise InputError(
            f"K: its factors of {K.shape[0]} unknowns do not fit into memory; allowed: fewer nodes"
        ) from None
    if K.shape[0] > MOST_PIVOTS:
        check_responses(factors, K, names)
    else:
        check_pivots(factors, K.diagonal(), names)
    return factors


Solve = Callable[[Array], Array]


def _clamped(basis: _Basis) -> Solve:
    """Return what loads of a clamped link do to its unknowns: K^-1."""
    factors = _factors(basis.K, basis.names)
    return lambda loads: np.asarray(factors.solve(loads))


def _free(basis: _Basis) -> Solve:
    """Return what loads do to a free link, beside its rigid-body motion: P K^-1 P^T, with P of no momentum."""
    R, M = basis.R, basis.M
    MR = M @ R
    G = np.linalg.inv(R.T @ MR)
    size = float(np.sqrt(np.square(R[:, 3:]).mean())) or 1.0
    support = independent_columns((R / np.array([1.0] * 3 + [size] * 3)).T, 6)
    others = np.setdiff1d(np.arange(basis.size), support)
    factors = _factors(basis.K[others][:, others].tocsc(), lambda row: basis.names(int(others[row])))

    def solve(loads: Array) -> Array:
        balanced = loads - MR @ (G @ (R.T @ loads))
        moved = np.zeros_like(balanced)
        moved[others] = factors.solve(balanced[others])
        return np.asarray(moved - R @ (G @ (MR.T @ moved)))

    return solve


def _static_shapes(elements: FiniteElements, basis: _Basis, solve: Solve) -> Array:
    """Return the shapes of unit displacements of the interfaces, (size, 6 I), all else free of forces.

    Raises:
        InputError: an interface cannot move by itself: it is rigid with another one or with the root.
    """
    if not elements.interfaces:
        return np.zeros((basis.size, 0))
    X = solve(basis.A.T.toarray())
    flexibility = basis.A @ X
    flexibility = 0.5 * (flexibility + flexibility.T)
    for k, interface in enumerate(elements.interfaces):
        yielding = flexibility.diagonal()[6 * k : 6 * k + 6]
        if not yielding.min() > 0.0:
            direction = DIRECTIONS[int(yielding.argmin())]
            got = f"its flexibility along {direction} is {yielding.min():.2g}"
            raise InputError(
                f"interface {interface.name}: {got}; allowed: above 0, of nodes that are not held by the root"
            )
    scale = np.sqrt(flexibility.diagonal())
    least = float(np.linalg.eigvalsh(flexibility / np.outer(scale, scale))[0])
    if least < INDEPENDENT:
        names = ", ".join(interface.name for interface in elements.interfaces)
        got = f"their flexibility, scaled, has the eigenvalue {least:.1e}"
        raise InputError(f"interfaces {names}: {got}; allowed: above {INDEPENDENT:g}, of sets that move independently")
    return np.asarray(X @ np.linalg.inv(flexibility))


def _eigenmodes(elements: FiniteElements, basis: _Basis, solve: Solve, static: Array) -> Array:
    """Return the lowest modes, (size, count): with fixed interfaces, or free of momenta where the link is free."""
    is_free, count = len(elements.root) == 0, elements.count
    constraints = (basis.M @ basis.R).T if is_free else basis.A.toarray()
    most = basis.size - len(constraints)
    if count > most:
        raise InputError(
            f"count: got {count} modes; allowed: up to {most}, as there are so many unknowns beside interfaces"
        )
    if count == 0:
        return np.zeros((basis.size, 0))

    def response(loads: Array) -> Array:
        moved = solve(loads)
        return moved if is_free or not static.shape[1] else moved - static @ (basis.A @ moved)

    if basis.size <= DENSE or 3 * count > most:
        if basis.size > MOST_DENSE:
            raise InputError(f"count: got {count} modes; allowed: up to {most // 3} of {basis.size} unknowns")
        return _lowest_dense(basis, constraints, count)
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    start = response(basis.M @ np.random.default_rng(0).standard_normal(basis.size))
    inverse = LinearOperator(basis.K.shape, matvec=lambda b: response(b.reshape(-1)), dtype=np.float64)
    try:
        _, V = eigsh(basis.K, k=count, M=basis.M, sigma=0.0, OPinv=inverse, v0=start, which="LM")
    except ArpackNoConvergence as error:
        found = len(error.eigenvalues)
        raise InputError(f"count: {found} of {count} modes converge; allowed: fewer modes") from None
    return np.asarray(V)


def _lowest_dense(basis: _Basis, constraints: Array, count: int) -> Array:
    """Return the lowest modes of a small link, by full matrices over what constraints leave free."""
    from scipy.linalg import eigh, null_space

    Z = (
        null_space(constraints / np.linalg.norm(constraints, axis=1, keepdims=True))
        if len(constraints)
        else np.eye(basis.size)
    )
    K, M = Z.T @ (basis.K @ Z), Z.T @ (basis.M @ Z)
    # the greatest 1 / w^2 first: M may have coordinates without mass, K is positive definite
    inverse_squares, V = eigh(0.5 * (M + M.T), 0.5 * (K + K.T), subset_by_index=(len(K) - count, len(K) - 1))
    if not inverse_squares[0] > NO_MASS * inverse_squares[-1]:
        have = int(np.count_nonzero(inverse_squares > NO_MASS * inverse_squares[-1]))
        raise InputError(f"count: got {count} modes; allowed: up to {have}, as so many have a mass")
    return np.asarray(Z @ (V / np.sqrt(inverse_squares)))[:, ::-1]


def _own_modes(K: Array, masses: Array) -> tuple[Array, Array]:
    """Return the modes of a reduced model, columns of unit modal mass, and their squared frequencies, (rad/s)^2."""
    from scipy.linalg import eigh

    scale = np.sqrt(masses.diagonal())
    least = float(np.linalg.eigvalsh(masses / np.outer(scale, scale))[0]) if scale.min() > 0.0 else 0.0
    if least < INDEPENDENT:
        got = f"modal masses, scaled, have the eigenvalue {least:.1e}"
        raise InputError(f"M: {got}; allowed: above {INDEPENDENT:g}: masses that all shapes move, or fewer modes")
    squares, turn = eigh(K / np.outer(scale, scale), masses / np.outer(scale, scale))
    if not squares[0] > 0.0:
        got = f"a mode of the reduced link has the stiffness {squares[0]:.3g} N/m for each kg"
        raise InputError(f"K: {got}; allowed: above 0, of a positive definite matrix")
    return turn / scale[:, None], squares


def _constants(elements: FiniteElements, modes: Array, Phi: Array, K: Array, frequencies: Array) -> ReducedLink:
    """Return the constants of modes, (n, m), with interfaces' displacements Phi and stiffness K, without round-off."""
    signs = np.sign(modes[np.abs(modes).argmax(axis=0), np.arange(modes.shape[1])])
    if not np.array_equal(Phi, np.eye(*Phi.shape)):  # own modes: a sign that does not depend on the solver
        modes, Phi = modes * signs, Phi * signs
    result = integrals(elements, modes)
    sizes = np.sqrt(np.einsum("kkaa->k", result.P))
    stiff = np.sqrt(K.diagonal())
    K = np.where(np.abs(K) > NEGLIGIBLE * np.outer(stiff, stiff), K, 0.0)
    m = len(K)
    Phi = Phi.reshape(len(elements.interfaces), 6, m)
    Q = Psi = None
    if elements.stress:
        stiffening = {case: modes.T @ (matrix @ modes) for case, matrix in elements.stress.items()}
        Q = np.zeros((m, m, 4, 3))
        for row, j in enumerate(("x", "y", "z", "1")):
            for i in range(3):
                Q[:, :, row, i] = symmetric(stiffening[f"body.{j}.{DIRECTIONS[i]}"])
        Psi = np.array([[symmetric(stiffening[f"{f.name}.{i}"]) for i in DIRECTIONS[:3]] for f in elements.interfaces])
        Psi = Psi.reshape(len(elements.interfaces), 3, m, m)
    return ReducedLink(
        H00=_clean_inertia(result.H00),
        H0=np.concatenate([_without_noise(result.H0[:, :3], sizes), _without_noise(result.H0[:, 3:], sizes)], axis=1),
        P=_clean_products(result.P, sizes),
        K=K,
        D=np.zeros_like(K),
        Q=Q,
        interface_names=tuple(interface.name for interface in elements.interfaces),
        interface_places=np.array([interface.place for interface in elements.interfaces]).reshape(-1, 3),
        interface_Phi=_clean_rows(Phi, sizes),
        interface_Psi=Psi,
        frequencies=frequencies,
        masses_are=result.how,
        is_free=len(elements.root) == 0,
    )


def symmetric(matrix: Array) -> Array:
    """Return the symmetric part of a matrix."""
    return np.asarray(0.5 * (matrix + matrix.T))


def _without_noise(entries: Array, sizes: Array) -> Array:
    """Return entries by modes, (m, ...), with exact zeros for round-off, measured by modes of unit modal mass."""
    by_mode = sizes.reshape((-1,) + (1,) * (entries.ndim - 1))
    limit = NEGLIGIBLE * by_mode * np.abs(entries / by_mode).max(initial=0.0)
    return np.where(np.abs(entries) > limit, entries, 0.0)


def _clean_inertia(H00: Array) -> Array:
    """Return H00 with exact zeros for round-off, measured by the link's mass and size."""
    moments = float(np.trace(H00[:3, :3]))
    if not moments >= 0.0:
        raise InputError(f"M: has second moments of mass of {moments:.3g} kg m^2 together; allowed: 0 or more")
    sizes = np.append(np.full(3, np.sqrt(moments)), np.sqrt(H00[3, 3]))
    return np.where(np.abs(H00) > NEGLIGIBLE * np.outer(sizes, sizes), H00, 0.0)


def _clean_rows(Phi: Array, sizes: Array) -> Array:
    """Return displacements of interfaces, (I, 6, m), with exact zeros for round-off, translations and rotations
    apart."""
    by_mode = np.moveaxis(Phi, 2, 0)
    parts = [_without_noise(by_mode[:, :, :3], sizes), _without_noise(by_mode[:, :, 3:], sizes)]
    return np.moveaxis(np.concatenate(parts, axis=2), 0, 2)


def _clean_products(P: Array, sizes: Array) -> Array:
    """Return P with exact zeros for round-off, P_lk the transpose of P_kl, and modal masses that vanish exactly 0."""
    scale = np.outer(sizes, sizes)
    P = 0.5 * (P + np.transpose(P, (1, 0, 3, 2)))
    P = np.where(np.abs(P) > NEGLIGIBLE * scale[:, :, None, None], P, 0.0)
    for k in range(len(P)):
        for j in range(k):
            block = P[k, j]
            if abs(np.trace(block)) <= NEGLIGIBLE * scale[k, j]:
                block[2, 2] = -(block[0, 0] + block[1, 1])
            P[j, k] = block.T
    return P
