"""Stiffness of coordinates, springs and transmissions as a kernel has it now, and the sizes that follow from it."""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import Array
from ..identifiers import check_kind
from ..kernel.by_name import follower_matrix
from ..kernel.complete import Kernel
from ..robot import sizes
from ..robot.laws import contact_stiffness_of, has_springs, rate_slope_of, states_of, stiffness_of
from ..robot.parameter_names import CUTS, JOINTS, LINES
from ..runtime.raw import Setup
from .elements import (
    Numbers,
    cut_matrices,
    element_couplings,
    element_numbers,
    element_slopes,
    joint_damping,
    joint_stiffness,
)
from .journals import cut_contacts, cut_stiffness, journal_contacts, journal_stiffness
from .motors import acting, deflections
from .vectors import V_STEP, prescribed_mask

_matrices: WeakKeyDictionary[Setup, Array] = WeakKeyDictionary()  # stiffness by what a kernel's parameters are now

SHARPEST = 1e-10  # m/s or rad/s: smaller rates are round-off
SHORTEST = 5e-10  # m/s or rad/s: of differences, whose round-off is below 1e-5 of a slope then


def stiffnesses(kernel: Kernel) -> Array:
    """Return the stiffness of every coordinate with the kernel's parameters, (n,), N/m or N m/rad; 0 without a spring.

    Laws count by their ``stiffness``: of two sides the stiffer one, of a clearance that of its end, of a curve that of
    its steepest piece, of a journal those of all its contacts.  A transmission holds its motor with stiffness / ratio^2
    and its joint with the stiffness, each as if the other stood still.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    return np.array(np.diagonal(stiffness_matrix(kernel)))


def stiffness_matrix(kernel: Kernel) -> Array:
    """Return ``stiffnesses`` with what transmissions and matrices have beside the diagonal, (n, n), read-only."""
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    setup = kernel.parameters.setup
    matrix = _matrices.get(setup)
    if matrix is None:
        numbers = law_numbers(kernel).items()
        slopes = np.array([stiffness_of(law, kernel.knots.get(name, ())) for name, law in numbers])
        rows = deflections(kernel)
        matrix = np.asarray(rows.T @ (slopes[:, None] * rows)) + journal_stiffness(kernel) + joint_stiffness(kernel)
        matrix.flags.writeable = False
        if kernel.parameters.setup is setup:  # nobody has assigned others in the meantime
            _matrices[setup] = matrix
    return matrix


def _contact_stiffness(kernel: Kernel) -> Array:
    """Return the stiffness of stops and of what states stretch, (n, n): of motors at shafts and in transmissions."""
    rows, numbers = deflections(kernel), law_numbers(kernel).items()
    at_shafts = [contact_stiffness_of(law, True if name in kernel.motors else None) for name, law in numbers]
    between = np.array([contact_stiffness_of(law, False) if name in kernel.motors else 0.0 for name, law in numbers])
    return np.asarray(rows.T @ (between[:, None] * rows) + np.diag(_on_diagonal(kernel, at_shafts)))


def _on_diagonal(kernel: Kernel, slopes: Sequence[float]) -> Array:
    """Return the diagonal over coordinates, (n,), of slopes by each of ``acting`` itself."""
    diagonal = np.array(slopes)
    return np.asarray(diagonal[: kernel.n] + diagonal[kernel.n :] @ follower_matrix(kernel)[0] ** 2)


def damping_matrix(kernel: Kernel, least: float = 0.0) -> Array:
    """Return the largest damping of dampers, friction and stops by the coordinates' rates, (n, n), N s/m or N m s/rad.

    A damper between motor and joint acts on the deflection, friction and stops of a motor on its shaft; isotropic
    damping of a joint's motion counts on the diagonal alone.  ``least`` as of ``rate_slope_of``.
    """
    rows, numbers = deflections(kernel), law_numbers(kernel).values()
    damping = np.array([law.get("damping", 0.0) for law in numbers])
    diagonal = _on_diagonal(kernel, [rate_slope_of(x, least) for x in numbers])
    return np.asarray(rows.T @ (damping[:, None] * rows) + np.diag(diagonal) + joint_damping(kernel))


def any_spring(kernel: Kernel) -> bool:
    """Whether there is a spring now: of a coordinate, a transmission, a loop joint, a coupling, between two links.

    A stop counts as one: what lies on it swings as on a spring.
    """
    tables = (*law_numbers(kernel).items(), *cut_numbers(kernel).items())
    if any(contact_stiffness_of(law) or has_springs(law, kernel.knots.get(name, ())) for name, law in tables):
        return True
    if any(contact.stiffness for contact in (*journal_contacts(kernel), *cut_contacts(kernel))):
        return True
    if element_slopes(kernel)[0].any() or joint_stiffness(kernel).any() or cut_matrices(kernel)[0].any():
        return True
    springs = element_numbers(kernel, LINES).values()
    return any(name in kernel.knots for name in kernel.springs) or any(x.get("stiffness") for x in springs)


def fastest_rates(kernel: Kernel, q: Array, least: float = 0.0) -> tuple[float, float]:
    """Return how fast springs swing and how fast dampers and friction slow down about q, rad/s and 1/s; 0 without any.

    Of all laws the largest slopes count, stops as if they were touched; prescribed coordinates do not; ``least`` as of
    ``rate_slope_of``.

    Raises:
        LinAlgError: M is singular.
    """
    between, damping = line_rates(kernel, q, least, touching=True)
    free = ~prescribed_mask(kernel)
    grid = np.ix_(free, free)
    stiffness = stiffness_matrix(kernel) + _contact_stiffness(kernel)
    slopes = [(stiffness + between)[grid], (damping_matrix(kernel, least) + damping)[grid]]
    if not np.any(slopes):
        return 0.0, 0.0
    M = kernel.mass_matrix(q)[grid]
    swing, slowing = (float(np.abs(np.linalg.eigvals(np.linalg.solve(M, slope))).max()) for slope in slopes)
    return float(np.sqrt(swing)), slowing


def law_numbers(kernel: Kernel) -> Numbers:
    """Return the force parameters of each of ``acting`` as the kernel has them now, by names of the table of laws."""
    laws = element_numbers(kernel, JOINTS)
    return {name: laws.get(name, {}) for name in acting(kernel)}


def cut_numbers(kernel: Kernel) -> Numbers:
    """Return the numbers of loop joints' coordinates and elastic couplings, by the names in ``Kernel.cut_laws``."""
    laws = element_numbers(kernel, CUTS)
    return {name: laws.get(name, {}) for name in kernel.cut_laws}


def smoothings(kernel: Kernel) -> dict[str, float]:
    """Return the smoothing rates of Coulomb friction, m/s or rad/s, by coordinate, of loop joints and couplings too."""
    values, key = kernel.parameters.state.values, "friction.smoothing"
    laws = {**kernel.elements.get(JOINTS, {}), **kernel.elements.get(CUTS, {})}
    return {name: float(values[places[key]]) for name, places in laws.items() if key in places}


def rate_step(kernel: Kernel) -> float:
    """Return the step of rates for finite differences of forces: small beside 1 and the rates where friction turns."""
    return min([V_STEP, *(max(0.02 * x, min(0.25 * x, SHORTEST)) for x in smoothings(kernel).values())])


def rubbing_rates(kernel: Kernel, q: Array) -> Array:
    """Return the least smoothing rates of the friction that acts on each coordinate, (n,); inf without any.

    Coarser ones would step over an equilibrium, and never find it.
    """
    rates, known = np.full(kernel.n, np.inf), smoothings(kernel)
    if not known:
        return rates
    rows = [
        *np.eye(kernel.n),
        *follower_matrix(kernel)[0],
        *(kernel.functions.cut_jacobian(q) if kernel.cut_laws else ()),
    ]
    for name, row in zip((*acting(kernel), *kernel.cut_laws), rows, strict=True):
        rates[row != 0.0] = np.minimum(rates[row != 0.0], known.get(name, np.inf))
    return np.asarray(np.maximum(rates, SHARPEST))


def clearances(numbers: Numbers) -> dict[str, float]:
    """Return the clearances to either side, m or rad, by name; that of a transmission by the motor's.

    Args:
        numbers: as of ``law_numbers`` or ``cut_numbers``.
    """
    return {name: law["clearance"] for name, law in numbers.items() if "clearance" in law}


def stops(numbers: Numbers) -> dict[str, tuple[float, float]]:
    """Return the stops of everything that has some, m or rad, by its name; infinite on a side without."""
    return {
        name: (law.get("stops.lower", -np.inf), law.get("stops.upper", np.inf))
        for name, law in numbers.items()
        if "stops.stiffness" in law
    }


def journals_in_play(kernel: Kernel) -> set[str]:
    """Return names of the coordinates of journals that no spring but the contact holds."""
    index = {i for contact in journal_contacts(kernel) for i in contact.index}
    laws = law_numbers(kernel) if index else {}
    springs = np.diagonal(joint_stiffness(kernel))
    names = {kernel.coordinates[i] for i in index if not springs[i]}
    return {name for name in names if not has_springs(laws[name], kernel.knots.get(name, ()))}


def line_rates(kernel: Kernel, q: Array, least: float = 0.0, *, touching: bool = False) -> tuple[Array, Array]:
    """Return the stiffness and damping by force elements between links, in loop joints and couplings at q, (n, n) each.

    Cables count as taut, journals of loop joints as touching; the largest slopes count.
    touching: stops count, too, as if they were touched.  ``least`` as of ``rate_slope_of``.
    """
    stiffness, slowing = np.zeros((kernel.n, kernel.n)), np.zeros((kernel.n, kernel.n))
    if kernel.springs:
        jacobian = kernel.functions.spring_jacobian(q)
        numbers = element_numbers(kernel, LINES)
        damping = np.array([numbers.get(name, {}).get("damping", 0.0) for name in kernel.springs])
        stiffness, slowing = (
            np.asarray(kernel.functions.spring_stiffness(q)),
            jacobian.T @ (damping[:, None] * jacobian),
        )
    if kernel.element_rows:
        rows, (k, c) = np.asarray(kernel.functions.element_jacobian(q)), element_slopes(kernel)
        stiffness, slowing = stiffness + rows.T @ (k[:, None] * rows), slowing + rows.T @ (c[:, None] * rows)
        between, beside = element_couplings(kernel)
        stiffness, slowing = stiffness + rows.T @ between @ rows, slowing + rows.T @ beside @ rows
    if kernel.cut_laws:
        rows, numbers = kernel.functions.cut_jacobian(q), cut_numbers(kernel)
        k = np.array([stiffness_of(numbers[name], kernel.knots.get(name, ())) for name in kernel.cut_laws])
        c = np.array([law.get("damping", 0.0) + rate_slope_of(law, least) for law in numbers.values()])
        k = k + [contact_stiffness_of(law) for law in numbers.values()] if touching else k
        stiffness = stiffness + rows.T @ (k[:, None] * rows) + cut_stiffness(kernel, q)
        slowing = slowing + rows.T @ (c[:, None] * rows)
        between, beside = cut_matrices(kernel)
        stiffness, slowing = stiffness + rows.T @ between @ rows, slowing + rows.T @ beside @ rows
    return np.asarray(stiffness), np.asarray(slowing)


def coordinate_sizes(kernel: Kernel, q: Array) -> tuple[Array, Array]:
    """Return sizes of coordinates and rates that tolerances refer to, (n,) each; m, rad, s.

    Stiffness is a coordinate's and that of springs between points, inertia the diagonal entry of M(q).
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    stiffness = stiffnesses(kernel) + np.diagonal(line_rates(kernel, q)[0])
    return sizes.deviation_sizes(stiffness, np.diagonal(kernel.mass_matrix(q)))


def rate_sizes(kernel: Kernel, q: Array) -> Array:
    """Return sizes of rates that tolerances refer to, (n,), and behind them those of internal states."""
    return np.append(coordinate_sizes(kernel, q)[1], internal_state_sizes(kernel))


def internal_state_sizes(kernel: Kernel) -> list[float]:
    """Return sizes of the internal states that tolerances refer to, (m,)."""
    sizes: dict[str, float] = {}
    for family in (JOINTS, CUTS) if kernel.internal_states else ():
        for owner, numbers in element_numbers(kernel, family).items():
            sizes |= {f"{owner}.{law}.{x.name}": x.size(numbers) for law, x in states_of(numbers)}
    return [sizes[name] for name in kernel.internal_states]
