"""Files of flexible links: written, read, placed and reduced at once; their constants against sums over particles."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from eomgen.bending import link_files, reduction
from eomgen.bending.beam import beam_inertia, beam_modes
from eomgen.bending.bending_body import BendingBody
from eomgen.bending.constants import body_of, constants_of_masses, modal_damping
from eomgen.bending.element_files import arrays_of
from eomgen.bending.files import write_constants
from eomgen.bending.link_files import HowToTake, read_link
from eomgen.bending.mass_integrals import EXACT, MEAN, REDUCED
from eomgen.bending.reducing import reduce_files
from eomgen.bending.reduction import reduce
from eomgen.errors import InputError
from eomgen.robot.value import BeamModes, LinkBeam, Node, Placement
from tests.support.beam_elements import Plane
from tests.support.bending_links import nested, random_points
from tests.support.finite_elements import bar, beam, stress_of_bar
from tests.support.refusals import refused

pytestmark = pytest.mark.quick
Arrays = dict[str, NDArray[Any]]
BOOM = LinkBeam(1.3, 7e10, 2.6e10, 4e-4, 2e-8, 5e-8, 3e-8, (0.85, 0.8), 2700.0, BeamModes(2, 1, 1, 1))
PLANE = Plane(3.5e3, 8.84e6, 1.08, 1.35e-4, 1.3)
COUNT = 12  # elements


def constants() -> Arrays:
    """A beam's constants as arrays of a file."""
    modes = beam_modes(BOOM, 0.01)
    (tip,) = modes.nodes
    return {
        "H00": beam_inertia(BOOM),
        **{key: np.array(getattr(modes, key)) for key in ("H0", "P", "Q", "K", "D")},
        "interface_names": np.array(["tip"]),
        "interface_places": np.array([tip.place]),
        "interface_Phi": np.array([tip.Phi]),
        "interface_Psi": np.array([tip.Psi]),
    }


def nodal(modes: int = 3, *, free: bool = False, moved: bool = False) -> Arrays:
    """Modes of a beam with lumped masses, in the plane of x and y; of a free one, perhaps moved to a still root."""
    masses = np.full(COUNT + 1, PLANE.along * PLANE.length / COUNT)
    masses[[0, -1]] /= 2.0
    about = masses * 1e-3
    span = PLANE.length / COUNT
    places = np.zeros((COUNT + 1, 3))
    places[:, 0] = np.arange(COUNT + 1) * span
    K = np.zeros((2 * COUNT + 2, 2 * COUNT + 2))
    for k in range(COUNT):
        K[2 * k : 2 * k + 4, 2 * k : 2 * k + 4] += PLANE.element(COUNT)[1]
    M = np.diag(np.column_stack([masses, about]).ravel())
    kept = slice(0 if free else 2, None)
    squares, X = eigh(K[kept, kept], M[kept, kept])
    X = X[:, 2 if free else 0 :][:, :modes]
    shapes = np.zeros((2 * COUNT + 2, modes))
    shapes[kept] = X
    if moved:
        shapes[::2] -= shapes[0] + places[:, :1] * shapes[1]
        shapes[1::2] -= shapes[1].copy()
    Phi = np.zeros((COUNT + 1, 6, modes))
    Phi[:, 1], Phi[:, 5] = shapes[::2], shapes[1::2]
    inertia = np.zeros((COUNT + 1, 3, 3))
    inertia[:, 1, 1] = inertia[:, 2, 2] = about
    return {
        "nodes": places,
        "mass": masses,
        "inertia": inertia,
        "Phi": Phi,
        "K": np.diag(squares[2 if free else 0 :][:modes]),
        "interface_names": np.array(["tip", "middle"]),
        "interface_nodes": np.array([COUNT, COUNT // 2]),
    }


def saved(arrays: Arrays, folder: Path) -> Path:
    path = folder / "arm.npz"
    np.savez(path, **arrays)
    return path


def test_constants_are_written_and_read_again(tmp_path: Path) -> None:
    modes, H00 = beam_modes(BOOM, 0.01), beam_inertia(BOOM)
    body = read_link(write_constants(tmp_path / "arm.npz", BendingBody(H00, modes, is_free=False)))
    assert body.modes == modes
    assert np.all(body.H00 == H00)
    assert not body.is_free
    refused(InputError, r"arm\.csv.*ends in \.npz", write_constants, tmp_path / "arm.csv", body)


def test_files_without_interfaces_or_second_order(tmp_path: Path) -> None:
    arrays = constants()
    left = {key: x for key, x in arrays.items() if key not in ("Q", "D", "interface_Psi")}
    body = read_link(saved(left, tmp_path))
    assert body.modes.Q is None
    assert body.modes.nodes[0].Psi is None
    assert not np.any(body.modes.D)
    left |= {"interface_names": np.array([], dtype=str)}
    left |= {"interface_places": np.zeros((0, 3)), "interface_Phi": np.zeros((0, 6, 5))}
    assert read_link(saved(left, tmp_path)).modes.nodes == ()


def test_modes_of_nodes(tmp_path: Path) -> None:
    """Masses and frequencies are those of the elements, nodes stand where they stood."""
    arrays = nodal()
    body = read_link(saved(arrays | {"M": np.eye(3)}, tmp_path))
    modes = body.modes
    assert np.array(modes.masses) == pytest.approx(np.eye(3), abs=1e-12)
    assert np.array(modes.K) == pytest.approx(arrays["K"], rel=1e-12)
    assert [node.name for node in modes.nodes] == ["tip", "middle"]
    assert modes.nodes[1].place == (0.65, 0.0, 0.0)
    assert np.all(np.array(modes.nodes[0].Phi) == arrays["Phi"][COUNT])
    assert body.H00[3, 3] == pytest.approx(PLANE.along * PLANE.length)
    along = arrays["inertia"][:, 2, 2]  # of each node, which turns with the beam
    assert body.H00[0, 0] == pytest.approx(arrays["mass"] @ arrays["nodes"][:, 0] ** 2 + along.sum())
    assert np.array(modes.H0)[:, 3, 1] == pytest.approx(arrays["mass"] @ arrays["Phi"][:, 1], rel=1e-12)
    moments = (arrays["mass"] * arrays["nodes"][:, 0]) @ arrays["Phi"][:, 1] + along @ arrays["Phi"][:, 5]
    assert np.array(modes.H0)[:, 0, 1] == pytest.approx(moments, rel=1e-12)
    three = {key: x for key, x in arrays.items() if not key.startswith("interface")}
    three["Phi"] = arrays["Phi"][:, :3]
    three["Phi"] = np.concatenate([three["Phi"], 0.0 * three["Phi"][:2]])  # two more nodes stand still
    three["nodes"] = np.concatenate([three["nodes"], [[0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]])
    three["mass"], three["inertia"] = np.append(three["mass"], [0.0, 0.0]), np.zeros((COUNT + 3, 3, 3))
    assert read_link(saved(three, tmp_path)).modes.nodes == ()


def test_modes_of_a_free_link_stay_so_or_are_refused(tmp_path: Path) -> None:
    body = read_link(saved(nodal(free=True), tmp_path))
    assert body.is_free
    with pytest.raises(InputError, match=r"'Phi': modes of a free link, moved .* allowed: .* clamped at its root"):
        read_link(saved(nodal(free=True, moved=True), tmp_path))


def put(key: str, place: tuple[int, ...], value: float) -> Callable[[Arrays], None]:
    """Change one number."""

    def change(arrays: Arrays) -> None:
        arrays[key] = arrays[key].copy()
        arrays[key][place] = value

    return change


def become(key: str, value: Any) -> Callable[[Arrays], None]:
    """Change a whole array; None: leave it out."""

    def change(arrays: Arrays) -> None:
        if value is None:
            del arrays[key]
        else:
            arrays[key] = np.asarray(value(arrays[key]) if callable(value) else value)

    return change


BAD_CONSTANTS: dict[str, tuple[Callable[[Arrays], None], str]] = {
    "no stiffness": (become("K", None), r"array 'K': it is missing; allowed: an array of m x m"),
    "stiffness of no modes": (become("K", np.zeros((0, 0))), r"'K': got shape \(0, 0\).*1 to 200 rows"),
    "stiffness that is none": (become("K", lambda x: -x), r"'K': its least eigenvalue is -.*positive definite"),
    "singular stiffness": (put("K", (0, 0), 0.0), r"'K': its least eigenvalue is 0, .*positive definite"),
    "stiffness of one side": (put("K", (0, 1), 1e9), r"'K': got 1e\+09 at \(1, 2\), 0 at its mirror.*symmetric"),
    "damping that drives": (become("D", lambda x: -x), r"'D': its least eigenvalue is -.*takes energy out"),
    "nan": (put("H0", (1, 2, 0), np.nan), r"'H0': got nan at \[1, 2, 0\]; allowed: finite numbers"),
    "infinity": (put("P", (0, 0, 1, 1), np.inf), r"'P': got inf at \[0, 0, 1, 1\]"),
    "texts": (become("K", np.array([["a"]])), r"'K': got shape \(1, 1\) of <U1; allowed: an array of m x m numbers"),
    "fewer modes": (become("H0", lambda x: x[:-1]), r"'H0': got shape \(4, 4, 3\).*5 x 4 x 3 numbers"),
    "no mass": (put("H00", (3, 3), 0.0), r"'H00': the mass is 0 kg; allowed: a number greater than 0"),
    "pseudo-inertia of one side": (put("H00", (0, 3), 9.0), r"'H00': got 9 at \(1, 4\)"),
    "masses of one side": (put("P", (0, 1, 0, 1), 9.0), r"'P': got 9 at \(1, 2, 1, 2\)"),
    "second order of one side": (put("Q", (0, 1, 0, 0), 9.0), r"'Q': got 9 at \(1, 2, 1, 1\)"),
    "mode without mass": (
        become(
            "P", lambda x: np.where(np.arange(5)[:, None, None, None] == 4, 0.0, x) * (np.arange(5) != 4)[:, None, None]
        ),
        r"'P': the mass of mode 5, tr P, is 0; allowed: a number greater than 0",
    ),
    "modes of another body": (
        become("H0", lambda x: 10.0 * x),
        r"'H0': masses of rigid motions .* eigenvalue -",
    ),
    "name that is none": (become("interface_names", ["a b"]), r"'interface_names': got 'a b'; allowed: an identifier"),
    "root as a name": (become("interface_names", ["root"]), r"'interface_names': got 'root'.*other than root"),
    "numbers as names": (become("interface_names", [1.0]), r"'interface_names': got shape \(1,\) of float64.*texts"),
    "many names": (
        become("interface_names", [f"n{k}" for k in range(201)]),
        r"'interface_names': has 201 names; allowed: up to 200",
    ),
    "many second orders": (
        become("interface_Psi", np.zeros((1, 3, 1200, 1200))),
        r"'interface_Psi': with interface_Phi it has 43200[0-9]+ numbers; allowed: up to 4000000",
    ),
    "two names": (become("interface_names", ["tip", "tip"]), r"'interface_names': 'tip' is there twice"),
    "more names": (become("interface_names", ["tip", "end"]), r"'interface_places': got shape \(1, 3\).*2 x 3 numbers"),
    "unknown array": (become("Qq", [1.0]), r"'Qq': it is unknown; allowed: H00, H0, P"),
}
BAD_NODAL: dict[str, tuple[Callable[[Arrays], None], str]] = {
    "mass below zero": (put("mass", (3,), -1.0), r"'mass': got -1 of node 3; allowed: numbers that are at least 0"),
    "no masses": (become("mass", lambda x: 0.0 * x), r"'mass': all masses are 0"),
    "inertia of no body": (put("inertia", (2, 1, 1), 9.0), r"'inertia': that of node 2 has a principal moment greater"),
    "inertia of one side": (put("inertia", (2, 0, 1), 9.0), r"'inertia': that of node 2 is off its transpose by 9"),
    "four rows": (become("Phi", lambda x: x[:, :4]), r"'Phi': got shape \(13, 4, 3\).*13 x 6 x 3 or 13 x 3 x 3"),
    "rows of translations": (become("Phi", lambda x: x[:, :3]), r"'Phi': .*(moves least|interfaces need rotations)"),
    "nothing clamped": (
        become("Phi", lambda x: x + 0.1),
        r"'Phi': the modes move node 0 at \(0, 0, 0\), which",
    ),
    "modal masses of others": (
        become("M", np.diag([2.0, 1.0, 1.0])),
        r"'M': got 2 at \(1, 1\), where mass and Phi give 1",
    ),
    "node of no number": (put("interface_nodes", (0,), 13), r"'interface_nodes': got 13 of 'tip'.*0 to 12"),
    "too few nodes": (become("interface_nodes", [1]), r"'interface_nodes': allowed: 2 numbers of nodes"),
    "nodes that are no numbers": (become("interface_nodes", [1.5, 2.0]), r"'interface_nodes': allowed: 2 numbers"),
    "equal modes": (
        become("Phi", lambda x: np.repeat(x[:, :, :1], 3, axis=2)),
        r"'P': modes are linearly dependent: the least eigenvalue",
    ),
    "finite elements": (become("M_data", [1.0]), r"'dofs' is missing; allowed: a file of finite elements"),
}


@pytest.mark.parametrize("case", BAD_CONSTANTS)
def test_bad_constants(case: str, tmp_path: Path) -> None:
    unread(constants(), *BAD_CONSTANTS[case], tmp_path)


@pytest.mark.parametrize("case", BAD_NODAL)
def test_bad_modes_of_nodes(case: str, tmp_path: Path) -> None:
    unread(nodal(), *BAD_NODAL[case], tmp_path)


def unread(arrays: Arrays, change: Callable[[Arrays], None], expected: str, folder: Path) -> None:
    """The changed arrays are refused in one line with the file's name."""
    change(arrays)
    caught = refused(InputError, "", read_link, saved(arrays, folder))
    message = str(caught)
    assert message.startswith(f"{folder / 'arm.npz'}: array ")
    assert re.search(expected, message), message
    assert message.isprintable()


def test_other_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has the arrays 'q'; allowed: constants \(H00, H0, P, K, ...\), modes of"):
        read_link(saved({"q": np.zeros(3)}, tmp_path))
    (tmp_path / "text.npz").write_text("H0", encoding="ascii")
    refused(InputError, r"text\.npz: is no \.npz", read_link, tmp_path / "text.npz")
    refused(InputError, r"none\.npz: cannot be read", read_link, tmp_path / "none.npz")


def test_large_files_are_refused_before_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = saved(nodal(), tmp_path)
    monkeypatch.setenv("EOMGEN_NPZ_MB", "1")
    np.savez_compressed(path, nodes=np.zeros((10**5, 3)), Phi=np.zeros((10**5, 6, 3)))
    refused(InputError, r"its arrays have \d+ bytes; allowed: up to 1048576", read_link, path)


Array = NDArray[np.float64]


def random_bodies(seed: int, count: int = 5, modes: int = 3) -> dict[str, Array]:
    """Small bodies of eight particles each, and how they move: arguments of ``constants_of_masses``, and particles."""
    rng = np.random.default_rng(seed)
    offsets = rng.normal(size=(count, 8, 3))
    weights = rng.uniform(0.1, 1.0, size=(count, 8))
    offsets -= np.einsum("np,npi->ni", weights, offsets)[:, None] / weights.sum(axis=1)[:, None, None]
    psi = rng.normal(size=(count, 3, modes, modes))
    return {
        "masses": weights.sum(axis=1),
        "places": rng.normal(size=(count, 3)),
        "moments": np.einsum("np,npi,npj->nij", weights, offsets, offsets),
        "translations": rng.normal(size=(count, 3, modes)),
        "rotations": rng.normal(size=(count, 3, modes)),
        "second": psi + psi.transpose(0, 1, 3, 2),
        "offsets": offsets,
        "weights": weights,
    }


def test_masses_at_nodes_are_sums_over_particles() -> None:
    data = random_bodies(1)
    offsets, weights = data.pop("offsets"), data.pop("weights")
    found = constants_of_masses(**data)
    m = found.count
    H00, H0, P, Q = np.zeros((4, 4)), np.zeros((m, 4, 3)), np.zeros((m, m, 3, 3)), np.zeros((m, m, 4, 3))
    for n in range(len(weights)):
        for d, mass in zip(offsets[n], weights[n], strict=True):
            rho = np.append(data["places"][n] + d, 1.0)
            phi = [data["translations"][n, :, k] + np.cross(data["rotations"][n, :, k], d) for k in range(m)]
            H00 += mass * np.outer(rho, rho)
            for k in range(m):
                H0[k] += mass * np.outer(rho, phi[k])
                for j in range(m):
                    P[k, j] += mass * np.outer(phi[k], phi[j])
                    Q[k, j] += mass * np.outer(rho, data["second"][n, :, k, j])
    assert pytest.approx(H00, rel=1e-12, abs=1e-12) == found.H00
    assert pytest.approx(H0, rel=1e-12, abs=1e-12) == found.H0
    assert pytest.approx(P, rel=1e-12, abs=1e-12) == found.P
    # the particles of a body have the second order of its centre
    assert found.Q[:, :, 3] == pytest.approx(Q[:, :, 3], rel=1e-12, abs=1e-12)
    assert pytest.approx(Q, rel=1e-12, abs=1e-12) == found.Q
    assert found.masses == pytest.approx(np.einsum("klii->kl", P), rel=1e-12)
    assert constants_of_masses(**{**data, "second": None}).Q is None


def test_the_body_of_a_pseudo_inertia() -> None:
    """A rod along x about its middle, off the origin: Steiner's theorem."""
    com, mass, length = np.array([0.5, -0.2, 0.3]), 2.0, 1.2
    H = np.zeros((4, 4))
    H[:3, :3] = mass * np.outer(com, com)
    H[0, 0] += mass * length**2 / 12
    H[:3, 3] = H[3, :3] = mass * com
    H[3, 3] = mass
    found, center, inertia = body_of(H)
    assert found == mass
    assert center == pytest.approx(com)
    assert inertia == pytest.approx((0.0, 0.24, 0.24, 0.0, 0.0, 0.0), abs=1e-15)


def test_damping_of_matrices_is_that_of_their_modes() -> None:
    rng = np.random.default_rng(3)
    M, K = (x @ x.T + 0.5 * np.eye(4) for x in rng.normal(size=(2, 4, 4)))
    D = modal_damping(M, K, 0.03)
    values, X = np.linalg.eig(np.linalg.solve(M, K))
    X = X / np.sqrt(np.einsum("ik,ij,jk->k", X, M, X))
    assert pytest.approx(np.diag(0.06 * np.sqrt(values)), abs=1e-12) == X.T @ D @ X
    plain = modal_damping(np.diag([1.0, 4.0]), np.diag([9.0, 16.0]), 0.5)
    assert plain.tolist() == [[3.0, 0.0], [0.0, 8.0]]


SMALL = {"counts": (2, 1, 1), "count": 2}
R, ORIGIN = Rotation.from_euler("ZYX", [0.7, -0.4, 1.1]).as_matrix(), np.array([0.3, -0.2, 0.5])


def test_placed_constants_are_those_of_points_that_were_moved() -> None:
    """All constants, second order and nodes among them."""
    rng = np.random.default_rng(1)
    points = random_points(rng, 3, second=True)
    zero, K = np.zeros((12, 3, 3)), np.diag([1.0, 2.0, 3.0])

    def body(turn: np.ndarray, origin: np.ndarray) -> BendingBody:
        place, phi = points.place @ turn.T + origin, np.einsum("ij,njk->nik", turn, points.phi)
        psi = np.einsum("ij,njkl->nikl", turn, points.psi)
        made = constants_of_masses(points.mass, place, zero, phi, np.zeros_like(phi), psi)
        Phi, Psi = np.vstack([phi[0], turn @ np.ones((3, 3))]), psi[0]
        node = Node("first", nested(place[0]), nested(Phi), nested(Psi))
        return BendingBody(made.H00, made.link_modes(K, 0.1 * K, [node]), is_free=False, velocity_terms=MEAN)

    found, wanted = body(np.eye(3), np.zeros(3)).placed(R, ORIGIN), body(R, ORIGIN)
    assert pytest.approx(wanted.H00, rel=1e-13) == found.H00
    for key in ("H0", "P", "Q", "K", "D"):
        exact = np.array(getattr(wanted.modes, key))
        assert np.array(getattr(found.modes, key)) == pytest.approx(exact, abs=1e-13 * np.abs(exact).max()), key
    (one,), (other,) = found.modes.nodes, wanted.modes.nodes
    for key in ("place", "Phi", "Psi"):
        assert np.array(getattr(one, key)) == pytest.approx(np.array(getattr(other, key)), abs=1e-14), key
    assert found.velocity_terms == MEAN


def test_modes_of_nodes_are_placed_with_their_inertia(tmp_path: Path) -> None:
    arrays = nodal()
    found = read_link(saved(arrays, tmp_path), HowToTake(rotation=R, origin=ORIGIN))
    turned = np.concatenate(
        [np.einsum("ij,njk->nik", R, arrays["Phi"][:, part]) for part in (slice(3), slice(3, 6))], 1
    )
    moved = {"nodes": arrays["nodes"] @ R.T + ORIGIN, "Phi": turned, "inertia": R @ arrays["inertia"] @ R.T}
    wanted = read_link(saved(arrays | moved, tmp_path))
    assert pytest.approx(wanted.H00, abs=1e-13) == found.H00
    assert np.array(found.modes.H0) == pytest.approx(np.array(wanted.modes.H0), abs=1e-13)
    assert np.array(found.modes.P) == pytest.approx(np.array(wanted.modes.P), abs=1e-13)
    assert [node.name for node in found.modes.nodes] == ["tip", "middle"]


@pytest.mark.parametrize("clamped", [True, False])
def test_finite_elements_are_reduced_once(clamped: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elements, made = bar(clamped=clamped, **SMALL), list[Any]()
    path = saved(arrays_of(elements), tmp_path)
    monkeypatch.setattr(link_files, "_reduced", {})  # other tests read the same elements
    monkeypatch.setattr(reduction, "reduce", lambda x: made.append((x, reduce(x))) or made[-1][1])
    body = read_link(path)
    (read, reduced), wanted = made[0], made[0][1].body()  # two reductions may differ in their last bits
    assert all(np.array_equal(x, arrays_of(read)[name]) for name, x in arrays_of(elements).items())
    assert body.modes == wanted.modes
    assert (body.H00 == wanted.H00).all()
    assert body.is_free is not clamped
    more = read_link(path, HowToTake(count=3))
    assert more.modes.count == wanted.modes.count + 1
    moved = read_link(path, HowToTake(rotation=R, origin=ORIGIN))
    assert moved.modes == body.placed(R, ORIGIN).modes
    reduced.save(tmp_path / "modes.npz")
    assert read_link(tmp_path / "modes.npz").modes == body.modes
    count = len(made)
    read_link(path)
    assert len(made) == count
    read_link(path, HowToTake(count=1))
    assert len(made) == count + 1


def test_finite_elements_in_millimetres(tmp_path: Path) -> None:
    """All four modes of the lowest frequencies, three of which are the same."""
    elements = bar(counts=(2, 1, 1), count=4)
    faces = tuple(replace(x, place=1e3 * x.place) for x in elements.interfaces)
    scaled = replace(elements, nodes=1e3 * elements.nodes, M=1e-3 * elements.M, K=1e-3 * elements.K, interfaces=faces)
    path = saved(arrays_of(scaled), tmp_path)
    wanted = reduce(elements)
    for found in (read_link(path, HowToTake(units="mm")), reduce_files([path], units="mm").body()):
        assert pytest.approx(wanted.H00, abs=1e-12) == found.H00
        assert np.array(found.modes.K) == pytest.approx(wanted.K, rel=1e-9)
        Phi, exact = np.array(found.modes.nodes[0].Phi), wanted.interface_Phi[0]
        compliance = exact @ np.linalg.inv(wanted.K) @ exact.T
        assert Phi @ np.linalg.inv(found.modes.K) @ Phi.T == pytest.approx(compliance, abs=1e-9 * compliance.max())


def test_a_reduced_link_is_placed(tmp_path: Path) -> None:
    elements = replace(bar(**SMALL), stress=stress_of_bar(bar(**SMALL), SMALL["counts"]))
    path = saved(arrays_of(elements), tmp_path)
    pose = Placement.from_rpy((0.3, -0.2, 0.5), (1.1, -0.4, 0.7))
    found = reduce_files([path], placement=pose)
    wanted = reduce(elements).body().placed(pose.rotation, pose.xyz)
    assert found.body().modes == wanted.modes
    assert found.mass == pytest.approx(reduce(elements).mass)
    assert found.com == pytest.approx(np.array(pose.rotation) @ reduce(elements).com + pose.xyz)
    with pytest.raises(InputError, match="placement: got a value of type list; allowed: a Placement"):
        reduce_files([path], placement=[0.0] * 6)  # type: ignore[arg-type]


def test_files_say_how_velocity_terms_were_found(tmp_path: Path) -> None:
    for elements, how, words in (
        (bar(**SMALL), EXACT, ""),
        (beam(), MEAN, "velocity terms of the modes come from mean"),
        (replace(beam(), reduced=True), REDUCED, "those of a reduced model"),
    ):
        body = read_link(reduce(elements).save(tmp_path / "modes.npz"))
        assert body.velocity_terms == how
        assert any(words in note for note in body.notes())
        assert body.notes() == reduce(elements).notes()
    wrong = {**constants(), "velocity_terms": np.array("guessed")}
    with pytest.raises(InputError, match="array 'velocity_terms': got 'guessed'; allowed: exact, mean of"):
        read_link(saved(wrong, tmp_path))


LARGE: dict[str, tuple[str, Callable[[], HowToTake | None]]] = {
    "rows": ("its matrices have 36 rows; allowed: up to 35 where a robot is read", lambda: None),
    "modes": ("got 51 modes beside .*; allowed: up to 50 where a robot is read", lambda: HowToTake(count=51)),
}


@pytest.mark.parametrize("case", LARGE)
def test_large_reductions_are_refused_with_the_command_for_them(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    message, how = LARGE[case]
    path = saved(arrays_of(bar(**SMALL)), tmp_path)
    if case == "rows":
        monkeypatch.setattr(link_files, "MOST_UNKNOWNS", 35)
    refused(InputError, f"arm.npz: {message}, .*: eomgen reduce arm.npz -o arm_modes.npz", read_link, path, how())


def test_what_is_for_finite_elements_is_refused_for_modes(tmp_path: Path) -> None:
    path = saved(constants(), tmp_path)
    for name, how in (("count", HowToTake(count=2)), ("units", HowToTake(units="mm"))):
        with pytest.raises(
            InputError, match=rf"arm\.npz: {name} is for finite elements; allowed: none, as it has modes"
        ):
            read_link(path, how)
    wrong = {**arrays_of(bar(**SMALL)), "root": np.array([99])}
    refused(InputError, r"arm\.npz: root: got a node 99", read_link, saved(wrong, tmp_path))
