"""One whole calibration of a UR5 beside FIGAROH's: ``python -m benchmarks.calibrating [--poses N] [--rounds N]``.

Both read the same file of poses and fit all parameters that these show, in turns in one process; the least of all
rounds counts.  Both then predict poses that nobody measured, beside which the truth stands.  Where FIGAROH is not
installed (pip install figaroh, which brings Pinocchio) that row is left out.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import logging
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.identification import calibrate
from eomgen.identification.geometry.stations import chain_of, located
from eomgen.kernel.inverse_kinematics.rotations import rpy_of
from eomgen.motion.turns import rotation_of

from .peers.cases import case

Array = NDArray[np.float64]

TOOL = "tool0"
NOISE = (5e-5, 1e-4)  # m and rad
OFFSETS = (5e-4, 2e-3)  # m and rad, standard deviations of what the arm is off by
HELD = 500  # poses that are predicted
CONFIG = """
robot: {{name: ur5, properties: {{joints: {{active_joints: {joints}}}}}}}
tasks:
  calibration:
    enabled: true
    parameters: {{calibration_level: full_params, include_non_geometric: false, outlier_threshold: 1.0}}
    kinematics: {{base_frame: universe, tool_frame: {tool}}}
    measurements:
      markers: [{{ref_joint: {last}, measurable_dof: [true, true, true, true, true, true]}}]
      poses: {{base_pose: [0, 0, 0, 0, 0, 0], tool_pose: [0, 0, 0, 0, 0, 0]}}
    data: {{source_file: {file}, number_of_samples: {count}}}
"""


@dataclass
class Trial:
    """Measured configurations and poses, others with their true poses, and the URDF; all in one folder."""

    urdf: Path
    joints: tuple[str, ...]
    q: Array
    poses: Array
    elsewhere: Array
    truth: Array
    folder: Path


def trial(folder: Path, count: int) -> Trial:
    """Return poses of a UR5 that is off in all six coordinates of every joint."""
    rng = np.random.default_rng(1)
    urdf = Path(case("UR5").urdf)
    robot = eomgen.load_robot(urdf)
    chain = chain_of(robot, {TOOL: (TOOL, np.eye(4))})
    moving = [k for k, station in enumerate(chain.stations) if station.joint is not None]
    q = rng.uniform(-np.pi, np.pi, (count + HELD, len(moving)))
    off = np.hstack([scale * rng.normal(size=(len(moving), 3)) for scale in OFFSETS])
    values = np.zeros((len(q), len(chain.stations), 6))
    for i, k in enumerate(moving):
        values[:, k] = off[i]
        values[:, k, 5] += q[:, i]
    at = located(chain, values, np.tile(np.eye(4), (len(q), 1, 1)))
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = at.R[chain.tools[TOOL]], at.p[chain.tools[TOOL]]
    seen = poses[:count].copy()
    seen[:, :3, 3] += NOISE[0] * rng.normal(size=(count, 3))
    seen[:, :3, :3] = rotation_of(NOISE[1] * rng.normal(size=(count, 3))) @ seen[:, :3, :3]
    names = tuple(str(chain.stations[k].name) for k in moving)
    return Trial(urdf, names, q[:count], seen, q[count:], poses[count:], folder)


def _write(path: Path, head: Sequence[str], columns: Sequence[Array]) -> Path:
    with path.open("w", newline="", encoding="ascii") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(np.hstack(columns).tolist())
    return path


def _angles(poses: Array) -> Array:
    return np.array([rpy_of(pose[:3, :3]) for pose in poses])


def ours(made: Trial) -> tuple[Callable[[], Any], Callable[[Any], Array]]:
    """Fit with eomgen, and return what it predicts elsewhere: positions, (HELD, 3), m."""
    head = [*(f"{name}.gamma" for name in made.joints), *(f"{TOOL}.{x}" for x in ("x", "y", "z", "rx", "ry", "rz"))]
    file = _write(made.folder / "ours.csv", head, (made.q, made.poses[:, :3, 3], _angles(made.poses)))
    robot = eomgen.load_robot(made.urdf)
    return (
        lambda: calibrate(robot, file, rotation="rpy", folds=0),
        lambda calibration: calibration.predict(made.elsewhere, TOOL, series=0)[0][:, :3, 3],
    )


def figaroh(made: Trial) -> tuple[Callable[[], Any], Callable[[Any], Array]]:
    """Return a fit and predictions by FIGAROH; ImportError where it is not installed."""
    import pinocchio
    from figaroh.calibration.base_calibration import BaseCalibration
    from figaroh.calibration.calibration_tools import calc_updated_fkm

    class Calibration(BaseCalibration):  # type: ignore[misc]
        """The cost function of its documentation."""

        def cost_function(self, var: Array) -> Any:
            predicted = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
            return self.apply_measurement_weighting(self._compute_logmap_residuals(self.PEE_measured, predicted))

    head = ["x1", "y1", "z1", "phix1", "phiy1", "phiz1", *made.joints]
    file = _write(made.folder / "figaroh.csv", head, (made.poses[:, :3, 3], _angles(made.poses), made.q))
    config = made.folder / "figaroh.yaml"
    words = {"joints": list(made.joints), "last": made.joints[-1], "tool": TOOL, "file": file, "count": len(made.q)}
    config.write_text(CONFIG.format(**words), encoding="ascii")
    model = pinocchio.buildModelFromUrdf(str(made.urdf))

    def fit() -> Any:
        robot = pinocchio.robot_wrapper.RobotWrapper(model)
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            calibration = Calibration(robot, str(config))
            calibration.calib_config["known_baseframe"] = calibration.calib_config["known_tipframe"] = False
            calibration.initialize()
            calibration.solve(enable_logging=False)
        return calibration

    def predict(calibration: Any) -> Array:
        config = {**calibration.calib_config, "NbSample": len(made.elsewhere)}
        flat = calc_updated_fkm(calibration.model, calibration.data, calibration.LM_result.x, made.elsewhere, config)
        return np.asarray(flat).reshape(6, -1)[:3].T

    return fit, predict


def main(words: Sequence[str] | None = None) -> int:
    """Measure, and print a row for each."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.calibrating", description="Calibrate a UR5 beside FIGAROH."
    )
    parser.add_argument("--poses", type=int, default=100, help="that are measured (100)")
    parser.add_argument("--rounds", type=int, default=5, help="turns of each (5)")
    options = parser.parse_args(words)
    logging.disable(logging.CRITICAL)
    with tempfile.TemporaryDirectory(prefix="eomgen-") as folder:
        made = trial(Path(folder), options.poses)
        peers = {"eomgen": ours(made)}
        try:
            peers["FIGAROH"] = figaroh(made)
        except ImportError as error:
            print(f"FIGAROH is left out: {error}")
        seconds: dict[str, list[float]] = {name: [] for name in peers}
        fits = {}
        for _ in range(options.rounds):
            for name, (fit, _) in peers.items():
                begin = perf_counter()
                fits[name] = fit()
                seconds[name].append(perf_counter() - begin)
        print(f"{options.poses} poses of a UR5, least of {options.rounds} turns, {processor_name()}")
        for name, (_, predict) in peers.items():
            off = np.linalg.norm(predict(fits[name]) - made.truth[:, :3, 3], axis=1)
            print(f"{name:<10}{min(seconds[name]):8.3f} s  off elsewhere {1e3 * np.sqrt(np.mean(off**2)):.4f} mm rms")
        if len(peers) > 1:
            print(f"FIGAROH takes {min(seconds['FIGAROH']) / min(seconds['eomgen']):.1f} times as long")
    return 0


if __name__ == "__main__":
    sys.exit(main())
