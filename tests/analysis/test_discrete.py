"""Bode responses and zero-order hold of linear systems, beside scipy.signal and a motion with drives that hold."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.signal
from scipy.integrate import solve_ivp

import eomgen
from eomgen.analysis import linearize, response
from eomgen.analysis.discrete import zero_order_hold
from eomgen.analysis.frequency import transfer_function
from eomgen.errors import ArrayError, InputError, UnknownNameError

pytestmark = pytest.mark.usefixtures("unoptimised")


@pytest.mark.parametrize("seed", range(6))
def test_random_systems_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    states, inputs, outputs = 2 * rng.integers(1, 5), rng.integers(1, 4), rng.integers(1, 4)
    A = rng.normal(size=(states, states)) * 10.0 ** rng.uniform(-1, 2)
    B, C, D = (rng.normal(size=x) for x in ((states, inputs), (outputs, states), (outputs, inputs)))
    dt = 10.0 ** rng.uniform(-3, -1)
    held = zero_order_hold(A, B, dt)
    expected = scipy.signal.cont2discrete((A, B, C, D), dt, method="zoh")
    for found, other in zip(held, expected, strict=False):
        assert np.abs(found - other).max() <= 1e-12 * np.abs(other).max()
    hertz = np.geomspace(0.1, 50.0, 9)
    H = transfer_function(A, B, C, D, hertz)
    for i in range(inputs):
        for o in range(outputs):
            _, single = scipy.signal.freqresp((A, B[:, [i]], C[[o]], D[[o]][:, [i]]), 2.0 * np.pi * hertz)
            assert np.abs(H[:, o, i] - single).max() <= 1e-9 * np.abs(single).max()


@pytest.mark.filterwarnings("ignore:Badly conditioned filter coefficients")
def test_of_a_robot() -> None:
    about = linearize(eomgen.load_robot("shaken_arm"), {"elbow": 0.5}, outputs=["tcp.x", "elbow.gamma"])
    bode = about.bode("elbow.gamma", ["tcp.x"])
    assert bode.inputs == ("elbow.gamma",)
    assert bode.outputs == ("tcp.x",)
    assert bode.H.shape == bode.magnitude.shape == bode.phase.shape == (400, 1, 1)
    A, B, C, D = about.matrices
    i, o = about.inputs.index("elbow.gamma"), about.outputs.index("tcp.x")
    w, decibels, degrees = scipy.signal.bode((A, B[:, [i]], C[[o]], D[[o]][:, [i]]), 2.0 * np.pi * bode.frequencies)
    assert np.abs(w / 2.0 / np.pi - bode.frequencies).max() < 1e-9 * w.max()
    assert np.abs(20.0 * np.log10(bode.magnitude[:, 0, 0]) - decibels).max() < 1e-6
    turns = (np.degrees(bode.phase[:, 0, 0]) - degrees) / 360.0
    assert np.abs(turns - np.round(turns[0])).max() < 1e-6
    hertz = [1.0, 7.0]
    same = response("shaken_arm", ["elbow.gamma"], ["tcp.x"], hertz, {"elbow": 0.5}, drives="free")
    assert np.abs(about.bode("elbow.gamma", "tcp.x", hertz).H - same.H).max() <= 1e-8 * np.abs(same.H).max()

    dt = 2e-3
    discrete = about.discretize(dt)
    assert discrete.matrices[4] == dt
    for found, other in zip(discrete.matrices, scipy.signal.cont2discrete(about.matrices, dt)[:4], strict=False):
        assert np.abs(found - other).max() <= 1e-11 * max(1.0, np.abs(other).max())
    x, held = np.zeros(len(A)), np.random.default_rng(0).normal(size=(5, B.shape[1]))
    state = x
    for w_k in held:
        state = discrete.A @ state + discrete.B @ w_k
        moved = solve_ivp(lambda t, y, w_k=w_k: A @ y + B @ w_k, (0.0, dt), x, rtol=1e-11, atol=1e-14, method="Radau")
        x = moved.y[:, -1]
    assert np.abs(state - x).max() <= 1e-7 * np.abs(x).max()
    assert json.loads(json.dumps(discrete.as_dict()))["dt"] == dt
    assert "every 0.002 s" in str(discrete)


def test_what_is_refused() -> None:
    about = linearize(eomgen.load_robot("one_link"), outputs=["joint1.gamma"])
    for dt in (0.0, -1.0, np.nan, np.inf, "fast", None, True):
        with pytest.raises(InputError, match=r"dt: .*allowed: a time above 0"):
            about.discretize(dt)  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=r"input: 'joint1\.gama' is not in this system; did you mean"):
        about.bode("joint1.gama")
    with pytest.raises(UnknownNameError, match="output: 'tcp' is not in this system; known: joint1"):
        about.bode(outputs=["tcp"])
    with pytest.raises(InputError, match="inputs: 3; allowed: a sequence of names"):
        about.bode(3)  # type: ignore[arg-type]
    with pytest.raises(ArrayError, match="frequencies"):
        about.bode(frequencies=[-1.0])
    with pytest.raises(InputError, match="bode: infinite at 0 Hz"):
        transfer_function(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((1, 1)), np.zeros(1))
