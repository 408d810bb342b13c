"""Files of measured motions: what is read, and how what is wrong is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.motion.files import MeasuredMotion, motion_from_columns, read_motion, write_motion
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

NAMES = ("joint1.x", "joint1.gamma")


def test_csv(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(
        "# measured on the bench\n t , joint1.gamma,joint1.gamma.rate, joint1.gamma.drive\n"
        "0,0.1,1.5,-2\n\n# pause\n0.5,1e-3,2,3.25\n"
    )
    motion = read_motion(path, NAMES)
    assert motion.t.tolist() == [0.0, 0.5]
    assert motion.q.tolist() == [[0.0, 0.1], [0.0, 1e-3]]
    assert motion.v is not None
    assert motion.v.tolist() == [[0.0, 1.5], [0.0, 2.0]]
    assert motion.a is None
    assert motion.u.tolist() == [[0.0, -2.0], [0.0, 3.25]]
    assert (motion.measured, motion.driven) == (("joint1.gamma",), ("joint1.gamma",))


@pytest.mark.parametrize("with_rates", [True, False])
def test_what_is_written_is_read_to_the_bit(with_rates: bool, tmp_path: Path) -> None:
    random = np.random.default_rng(7)
    q, v, a, u = random.normal(size=(4, 30, 2)) * 10.0 ** random.integers(-12, 9, (4, 30, 2))
    motion = MeasuredMotion(
        coordinates=NAMES,
        t=np.cumsum(random.uniform(1e-3, 1.0, 30)),
        q=q,
        v=v if with_rates else None,
        a=a if with_rates else None,
        u=np.where([False, True], u, 0.0),
        measured=NAMES,
        driven=NAMES[1:],
    )
    path = write_motion(tmp_path / "m.csv", motion, ["one", "two"])
    assert path.read_text().startswith("# one\n# two\nt,joint1.x,joint1.gamma,")
    again = read_motion(path, NAMES)
    for name in ("t", "q", "v", "a", "u"):
        ours, theirs = getattr(motion, name), getattr(again, name)
        assert (ours is None) == (theirs is None)
        assert ours is None or ours.tobytes() == theirs.tobytes(), name
    assert (again.measured, again.driven) == (NAMES, NAMES[1:])
    refused(InputError, r"m\.npz'; allowed: a path that ends in \.csv", write_motion, tmp_path / "m.npz", motion)


def test_npz_of_columns_and_of_a_simulation(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 5)
    np.savez(tmp_path / "a.npz", t=t, **{"joint1.x": t**2})
    assert np.array_equal(read_motion(tmp_path / "a.npz", NAMES).q[:, 0], t**2)
    from eomgen.simulation.run import simulate

    result = simulate(eomgen.load_robot("one_link"), duration=0.1)
    motion = read_motion(result.save(tmp_path / "trajectory.npz"), NAMES)
    for name in ("t", "q", "v", "u"):
        assert np.array_equal(getattr(motion, name), getattr(result.trajectory, name))
    assert motion.measured == NAMES


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("has no values", "header")),
        ("t,joint1.x\n", ("has no values",)),
        ("t,joint1.x\n0,1\n1,abc\n", ("line 3", "'joint1.x'", "'abc'", "finite number")),
        ("t,joint1.x\n0,1\n1,nan\n", ("line 3", "'joint1.x'", "'nan'", "finite number")),
        ("t,joint1.x\n0,1\n# c\n1\n", ("line 4", "1 values", "allowed: 2")),
        ("t,joint1.x\n0,1\n1,1\n1,2\n", ("line 4", "'t'", "1 after 1", "increasing")),
        ("t,joint1.x,joint1.x\n0,1,1\n", ("line 1", "column 3", "twice")),
        ("t,joint1.w\n0,1\n", ("'joint1.w'", "did you mean 'joint1.x'", "allowed: t")),
        ("joint1.x\n0\n", ("no column t",)),
        ("t\n0\n", ("no column is a coordinate", "joint1.x")),
        ("t,joint1.x,joint1.gamma,joint1.x.rate\n0,1,1,1\n", ("joint1.gamma.rate is missing",)),
        ("t,joint1.x,joint1.gamma.rate\n0,1,1\n", ("is missing",)),
        ("t,joint1.x,joint1.x.acceleration\n0,1,1\n", ("accelerations without rates",)),
    ],
)
def test_bad_csv_is_refused_with_its_place(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(text)
    with pytest.raises(InputError) as raised:
        read_motion(path, NAMES)
    for word in (str(path), *words):
        assert word in str(raised.value)


def test_other_bad_files(tmp_path: Path) -> None:
    (tmp_path / "latin.csv").write_bytes(b"t,joint1.x\n0,\xff\n")
    (tmp_path / "no.npz").write_bytes(b"PK nothing")
    np.savez(tmp_path / "short.npz", t=np.arange(3.0), **{"joint1.x": np.arange(2.0)})
    np.savez(tmp_path / "text.npz", t=np.arange(3.0), **{"joint1.x": np.array(["a", "b", "c"])})
    np.savez(tmp_path / "shape.npz", t=np.arange(3.0), q=np.zeros((3, 1)), coordinates=NAMES)
    np.savez(tmp_path / "nan.npz", t=np.arange(3.0), **{"joint1.x": np.array([0.0, np.nan, 1.0])})
    for name, words in (
        ("missing.csv", ("cannot be read",)),
        ("m.txt", ("allowed: a path that ends in .csv or .npz",)),
        ("latin.csv", ("byte 13", "UTF-8")),
        ("no.npz", ("is no .npz",)),
        ("short.npz", ("'joint1.x'", "shape (2,)", "(3,)")),
        ("text.npz", ("'joint1.x'", "dtype <U1")),
        ("shape.npz", ("array q", "(3, 1)", "(3, 2)")),
        ("nan.npz", ("sample 1", "'joint1.x'", "nan")),
    ):
        with pytest.raises(InputError) as raised:
            read_motion(tmp_path / name, NAMES)
        assert all(word in str(raised.value) for word in words), str(raised.value)
    refused(InputError, "one length", motion_from_columns, {"t": np.arange(3.0), "joint1.x": np.arange(2.0)}, NAMES)
