"""The ratios to hold: a peer's time by eomgen's, in one run on one core, eomgen's code compiled natively."""

from __future__ import annotations

from collections.abc import Mapping

from .cases import CHAIN, ELASTIC

# (case, kernel, batch) -> the least ratio
AGAINST_PINOCCHIO: Mapping[tuple[str, str, bool], float] = {
    ("UR5", "inverse_dynamics", False): 6.0,
    ("Talos", "inverse_dynamics", False): 6.0,
    (CHAIN, "inverse_dynamics", False): 6.0,
    ("UR5", "mass_matrix", False): 4.0,
    ("Talos", "mass_matrix", False): 4.0,
    (CHAIN, "mass_matrix", False): 3.0,
    ("UR5", "forward_dynamics", False): 5.0,
    ("Talos", "forward_dynamics", False): 5.0,
    (CHAIN, "forward_dynamics", False): 15.0,
    ("UR5", "inverse_dynamics", True): 25.0,
    ("Talos", "inverse_dynamics", True): 25.0,
    (CHAIN, "inverse_dynamics", True): 30.0,
    ("UR5", "derivatives", False): 6.0,
    ("Talos", "derivatives", False): 4.0,
    (CHAIN, "derivatives", False): 4.0,
    ("UR5", "forward_derivatives", False): 4.0,
    ("Panda", "forward_derivatives", False): 4.0,
    ("Talos", "forward_derivatives", False): 3.0,
    (CHAIN, "forward_derivatives", False): 4.0,
    ("UR5", "second_derivatives", False): 4.0,
    ("Panda", "second_derivatives", False): 4.0,
    ("Talos", "second_derivatives", False): 4.0,
    (CHAIN, "second_derivatives", False): 4.0,
}
AGAINST_MUJOCO: Mapping[tuple[str, str, bool], float] = {
    (ELASTIC, "step", False): 10.0,
    (ELASTIC, "step", True): 40.0,
}


def required(peer: str, case: str, kernel: str, batch: bool) -> float | None:
    """Return the ratio that is required of this comparison, or None."""
    table = {"Pinocchio": AGAINST_PINOCCHIO, "MuJoCo": AGAINST_MUJOCO}.get(peer, {})
    return table.get((case, kernel, batch))
