"""Numbers of measured files as no instrument gives them: refused by name, or whatever is printed is finite."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eomgen.errors import InputError
from eomgen.identification import calibrate, poses_from_columns, read_covariances, tolerance
from eomgen.motion.files import motion_from_columns, read_motion
from eomgen.motion.measured_numbers import answers_in_numbers, checked_numbers
from tests.support.extreme_numbers import COUNTS, analysis, ending_of, read, written
from tests.support.measured_poses import chain, trial
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("kind", soaked(COUNTS, set(COUNTS) - {"calibrate"}))
def test_right_numbers_are_answered_in_numbers(kind: str, tmp_path: Path) -> None:
    """Extreme ones are in test_surfaces."""
    read(kind, written(tmp_path / f"right{ending_of(kind)}", analysis(kind)[0]))


@pytest.mark.parametrize("value", [1e31, -1e150, 1e300, 1.7e308])
def test_all_readers_have_the_limit_of_descriptions(value: float, tmp_path: Path) -> None:
    """CSV, NPZ and arrays, of motions, poses, covariances, tables, with place and column."""
    what = "allowed: a finite number of magnitude up to 1e\\+30"
    motion = {"t": np.arange(3.0), "joint1.gamma": np.array([0.0, value, 1.0])}
    for ending, place in ((".csv", "line 3"), (".npz", "sample 1")):
        path = written(tmp_path / f"m{ending}", motion)
        with pytest.raises(InputError, match=rf"m{ending}: {place}: column 'joint1.gamma': .*{what}"):
            read_motion(path, ("joint1.gamma",))
    refused(InputError, rf"sample 1: column 'joint1.gamma': .*{what}", motion_from_columns, motion, ("joint1.gamma",))
    poses = {"joint1.gamma": np.zeros(2), **{f"tcp.{axis}": np.array([0.1, value]) for axis in "xyz"}}
    refused(InputError, rf"row 1: column 'tcp.x': .*{what}", poses_from_columns, poses, ("joint1.gamma",), ("tcp",))
    covariance = {f"tcp.{axis}": row for axis, row in zip("xyz", np.eye(3) * abs(value), strict=True)}
    with pytest.raises(InputError, match=rf"line 2: column 'tcp.x': .*{what}"):
        read_covariances([written(tmp_path / "c.csv", covariance)])
    with pytest.raises(
        InputError, match=r"joints.joint1.offset.x.bound: .*allowed: a finite number that is not negative, up"
    ):
        tolerance("one_link", {"joints.joint1.offset.x": {"bound": abs(value)}})


@pytest.mark.parametrize("value", [1e-31, 1e-300, 5e-324, 0.0])
def test_what_is_divided_by_is_not_too_small(value: float) -> None:
    """Standard deviations, variances, weights, and steps of time."""
    what = "allowed: a positive number from 1e-30 to 1e\\+30"
    poses = {"joint1.gamma": np.zeros(2), **{f"tcp.{axis}": np.array([0.1, 0.2]) for axis in "xyz"}}
    small = np.array([1.0, value])
    for name in ("weight", "tcp.sigma.x"):
        with pytest.raises(InputError, match=rf"row 1: column '{name}': .*{what}"):
            poses_from_columns({**poses, name: small}, ("joint1.gamma",), ("tcp",))
    made = trial(chain(3, "RR"), 1, 20)
    with pytest.raises(InputError, match=f"that of tcp is not .* on its diagonal; {what}"):
        calibrate(made.robot, made.poses("rx", "ry", "rz"), covariance={"tcp": np.diag([1e-8, 1e-8, value])})
    with pytest.raises(InputError, match=r"sample 1: column 't': .*allowed: increasing times, at least 1e-12 s apart"):
        motion_from_columns({"t": np.array([0.0, value]), "a": np.zeros(2)}, ("a",))


def test_what_is_no_number_is_said_with_its_place() -> None:
    with pytest.raises(InputError, match="row 0: array 'a' has dtype <U1; allowed: numbers"):
        checked_numbers("a", np.array(["x"]), lambda row: f"row {row}")
    assert np.isnan(checked_numbers("a", [np.nan, 1.0], lambda row: f"row {row}", blanks=True)[0])


def test_answers_that_are_no_numbers_are_refused() -> None:
    """With the name of the number and the file, wherever it stands in the result."""

    class Answer:
        def __init__(self, value: float) -> None:
            self.value = value

        def as_dict(self) -> dict[str, object]:
            return {"drives": [{"rms": 1.0}, {"rms": self.value}], "count": 3, "none": None}

    @answers_in_numbers("path")
    def analyse(value: float, path: str) -> Answer:
        if not value:
            raise np.linalg.LinAlgError("Singular matrix")
        return Answer(value)

    assert analyse(2.0, "file.csv").value == 2.0
    for value in (np.nan, np.inf):
        refused(InputError, rf"file\.csv: drives\[1\]\.rms comes out as {value}", analyse, value, path="file.csv")
    refused(InputError, r"file\.csv: numbers differ too much in size", analyse, 0.0, "file.csv")
