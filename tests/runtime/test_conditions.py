"""Numbers of laws go together in run-time parameters as in descriptions; what is refused changes nothing."""

from __future__ import annotations

import pickle
from collections.abc import Mapping

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from tests.support.builds import Build
from tests.support.refusals import refused

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning")]

AXIS = """
name = "axis"
[[links]]
name = "body"
mass = 1.0
inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }
[[joints]]
name = "joint1"
parent = "base"
child = "body"
type = "revolute"
"""
WOUND = {"stiffness": 300.0, "A": 1.0, "beta": 50.0, "gamma": 20.0, "n": 1.0, "share": 0.3}
BRISTLES = {"coulomb": 1.0, "static": 1.5, "gaussian": 0.1, "bristle_stiffness": 1e4, "bristle_damping": 30.0}
BRISTLES |= {"fade": 0.05}
COULOMB = {"coulomb": 1.0, "static": 1.5, "stribeck": 0.1}
STOPS = {"stiffness": 1e4, "lower": -0.5, "upper": 0.5}
LAWS = {"hysteresis": WOUND, "friction": BRISTLES, "stops": STOPS}
WORDS = {"hysteresis": 'model = "bouc_wen"', "friction": 'model = "lugre"'}


def _robot(laws: Mapping[str, Mapping[str, float]], words: Mapping[str, str] = WORDS) -> eomgen.Robot:
    tables = []
    for law, numbers in laws.items():
        named = {"gaussian": "stribeck"}
        said = [f"{named.get(key, key)} = {value!r}" for key, value in numbers.items()]
        tables.append(f"{law} = {{ {', '.join([*filter(None, [words.get(law)]), *said])} }}")
    return robot_from_toml(f"{AXIS}gamma = {{ {', '.join(tables)} }}\n")


CASES: dict[str, tuple[dict[str, float], str]] = {  # numbers that are set, and what is said
    "gamma": ({"hysteresis.gamma": -60.0}, r"gamma = -60\.0, where .*beta is 50; allowed: gamma from -beta to beta"),
    "beta": ({"hysteresis.beta": 10.0}, r"beta = 10\.0, where .*gamma is 20; allowed: gamma from -beta to beta"),
    "both": ({"hysteresis.beta": 70.0, "hysteresis.gamma": 70.1}, r"gamma = 70\.1; allowed: gamma from -beta"),
    "share": ({"hysteresis.share": 1.0}, r"share = 1\.0; allowed: share of less than 1"),
    "static": ({"friction.static": 0.9}, r"static = 0\.9, where .*coulomb is 1; allowed: static of at least coulomb"),
    "coulomb": ({"friction.coulomb": 0.0}, r"coulomb = 0\.0.*; allowed: coulomb of at least 1e-12, at which bristles"),
    "fade": ({"friction.fade": 1.0}, r"fade = 1\.0, where .*; allowed: bristle_damping or fade so low"),
    "damping": ({"friction.bristle_damping": 900.0}, r"bristle_damping = 900\.0, where .*allowed: bristle_damping or"),
    "stops": ({"stops.lower": 0.6}, r"lower = 0\.6, where .*stops\.upper is 0\.5; allowed: lower of at most upper"),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_what_a_description_refuses_is_refused(name: str, dtype: str, built: Build) -> None:
    kernel = built(_robot(LAWS), dtype=dtype)
    numbers, said = CASES[name]
    full = {f"joints.joint1.gamma.{key}": x for key, x in numbers.items()} | {"gravity.x": 2.0}
    before = dict(kernel.parameters)
    refused(InputError, rf"parameters: joints\.joint1\.gamma\..*{said}", kernel.parameters.update, full)
    assert dict(kernel.parameters) == before
    if len(numbers) == 1:
        key, value = next(iter(full.items()))
        with pytest.raises(InputError, match="several at once"):
            kernel.parameters[key] = value
        assert dict(kernel.parameters) == before
    changed = {law: dict(values) for law, values in LAWS.items()}
    for key, x in numbers.items():
        law, _, number = key.partition(".")
        changed[law][number] = x
    with pytest.raises(DescriptionError):
        _robot(changed)


def test_what_goes_together_is_set_at_once(built: Build) -> None:
    kernel = built(_robot(LAWS))
    name = "joints.joint1.gamma"
    wider = {f"{name}.hysteresis.beta": 80.0, f"{name}.hysteresis.gamma": -80.0}
    kernel.parameters.update(wider)
    kernel.parameters[f"{name}.hysteresis.share"] = np.nextafter(1.0, 0.0)
    kernel.parameters[f"{name}.friction.static"] = 1.0
    assert kernel.parameters[f"{name}.hysteresis.gamma"] == -80.0
    copied = kernel.parameters.copy()
    with pytest.raises(InputError, match="gamma from -beta to beta"):
        copied[f"{name}.hysteresis.beta"] = 79.0
    again = pickle.loads(pickle.dumps(kernel.parameters))
    assert dict(again) == dict(kernel.parameters)
    refused(InputError, "gamma from -beta to beta", again.update, {f"{name}.hysteresis.gamma": 81.0})


def test_conditions_are_those_of_descriptions(built: Build) -> None:
    """Random numbers: what an update takes is what a description takes."""
    kernels = [built(_robot(LAWS)), built(_robot({"friction": COULOMB}, {}))]
    rng, seen = np.random.default_rng(5), set[tuple[int, bool]]()
    for case in range(300):
        which = case % 4 == 0
        laws = {"friction": COULOMB} if which else LAWS
        changed = {law: dict(numbers) for law, numbers in laws.items()}
        values: dict[str, float] = {}
        for law, numbers in changed.items():
            for key in numbers:
                if key != "n" and rng.random() < 0.4:
                    factor = 10.0 ** rng.uniform(-1.0, 1.0) * (-1.0 if key == "gamma" and rng.random() < 0.5 else 1.0)
                    numbers[key] = values[f"joints.joint1.gamma.{law}.{key}"] = float(numbers[key] * factor)
        kernel = kernels[which].with_parameters()
        try:
            _robot(changed, {} if which else WORDS)
            allowed = True
        except DescriptionError:
            allowed = False
        try:
            kernel.parameters.update(values)
            taken = True
        except InputError:
            taken = False
        assert taken == allowed, values
        seen.add((int(which), taken))
    assert len(seen) == 4
