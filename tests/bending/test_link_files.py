"""Files of links of any grade: placed against points that were moved, finite elements that are reduced at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eomgen.bending import link_files, reduction
from eomgen.bending.bending_body import BendingBody
from eomgen.bending.constants import constants_of_masses
from eomgen.bending.element_files import arrays_of
from eomgen.bending.link_files import HowToTake, read_link
from eomgen.bending.mass_integrals import EXACT, MEAN, REDUCED
from eomgen.bending.reducing import reduce_files
from eomgen.bending.reduction import reduce
from eomgen.errors import InputError
from eomgen.robot.value import Node, Placement
from tests.bending.test_files import constants, nodal, saved
from tests.support.bending_links import nested, random_points
from tests.support.finite_elements import bar, beam, stress_of_bar
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

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
    elements = bar(clamped=clamped, **SMALL)
    path = saved(arrays_of(elements), tmp_path)
    body, wanted = read_link(path), reduce(elements).body()
    assert body.modes == wanted.modes
    assert (body.H00 == wanted.H00).all()
    assert body.is_free is not clamped
    more = read_link(path, HowToTake(count=3))
    assert more.modes.count == wanted.modes.count + 1
    moved = read_link(path, HowToTake(rotation=R, origin=ORIGIN))
    assert moved.modes == body.placed(R, ORIGIN).modes
    reduce(elements).save(tmp_path / "modes.npz")
    assert read_link(tmp_path / "modes.npz").modes == body.modes
    calls: list[object] = []
    monkeypatch.setattr(reduction, "reduce", lambda *given, **options: calls.append(given) or reduce(*given, **options))
    read_link(path)
    assert not calls
    read_link(path, HowToTake(count=1))
    assert len(calls) == 1


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
