"""Contacts pressed in far beyond a narrow smoothing: no digits may cancel, in single precision least of all."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.random_robots import Array

W, GAP, K, C = float(np.float32(1e-6)), 2.0**-5, 2.0**10, 0.25  # m, m, N/m, s/m: exact in any precision
KNOTS = {-2.0: -7.0, -1.0: -7.0, 0.0: 0.0, 1.0: 7.0, 2.0: 7.0}  # in units of W: N
CONTACT = f"stiffness = {K}, clearance = {GAP}, smoothing = {W}, restitution_damping = {C}"
SLIDES = {
    "clearance": "{ " + CONTACT + " }",
    "stops": f"{{ stops = {{ stiffness = {K}, damping = 1.5, restitution_damping = {C}, smoothing = {W}, "
    f"lower = {-GAP}, upper = {GAP} }} }}",
    "stiffness_negative": f"{{ stiffness = {K}, stiffness_negative = {2.0**40} }}",
    "stiffness_positive": f"{{ stiffness = {2.0**40}, stiffness_negative = {K} }}",
    "curve": f"{{ curve = {[[W * x, force] for x, force in KNOTS.items()]} }}",
}
BODY = """
[[links]]
name = "{0}_body"
mass = 1.0
inertia = {{ xx = 1.0, yy = 1.0, zz = 1.0 }}
[[joints]]
name = "{0}"
parent = "base"
child = "{0}_body"
"""
EPS = float(np.finfo(np.float32).eps)
NAMES = ("generalized_force", "residual_jacobian", "energy")


def slides() -> Robot:
    """A slide for every law, without gravity."""
    text = "".join(BODY.format(name) + f'type = "prismatic"\nz = {law}\n' for name, law in SLIDES.items())
    return robot_from_toml(f'name = "slides"\ngravity = [0.0, 0.0, 0.0]\n{text}')


def everywhere() -> Robot:
    """The same contact in a joint, a journal with a length, a coupling, a cut joint, its journal and a cable."""
    radial = f"radial = {{ {CONTACT}, length = 0.5, friction = {{ coefficient = 0.125, smoothing = 0.125 }} }}\n"
    cut = radial.replace("length = 0.5, ", "")
    six = "".join(f"{name} = {{}}\n" for name in ("x", "y", "alpha", "beta"))
    return robot_from_toml(
        'name = "everywhere"\ngravity = [0.0, 0.0, 0.0]\n'
        + BODY.format("pin") + f'type = "revolute"\n{six}{radial}'
        + BODY.format("one") + f'type = "prismatic"\nx = {{ {CONTACT} }}\ny = {{}}\n'
        + BODY.format("two") + 'type = "prismatic"\n'
        + f'[[couplings]]\nname = "belt"\nof = "one.z"\nto = {{ "two.z" = 2.0 }}\n{CONTACT.replace(", ", chr(10))}\n'
        + '[[loops]]\nname = "cut"\nlinks = ["base", "one_body"]\ntype = "fixed"\n'
        + f"x = {{}}\ny = {{}}\nz = {{ {CONTACT} }}\nalpha = {{ stiffness = 1.0 }}\nbeta = {{ stiffness = 1.0 }}\n"
        + f"gamma = {{ stiffness = 1.0 }}\n{cut}"
        + '[[springs]]\nname = "cable"\nlinks = ["base", "two_body"]\npoints = [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]\n'
        + f"free_length = 0.5\nstiffness = {K}\ntension_only = true\nsmoothing = {W}\n"
    )  # fmt: skip


def deep(s: Array, v: Array) -> tuple[Array, Array, Array]:
    """Force towards positive s of the contact at its positive end, d_dot and its energy, in long double."""
    x = np.abs(s.astype(np.longdouble)) - GAP
    d = np.where(x < W, x * x / (2 * W), x - np.longdouble(W) / 2)
    energy = np.where(x < W, x**3 / (6 * W), d * d / 2 + np.longdouble(W) ** 2 / 24)
    inside = x <= 0.0
    rate = np.sign(s) * v.astype(np.longdouble) * np.clip(x / W, 0, 1)
    return np.where(inside, 0, K * d), rate, np.where(inside, 0, K * energy)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_they_have_all_digits(dtype: str, built: Build) -> None:
    """Forces, slopes and energies of both sides against branches in long double, at all depths."""
    kernel = built(slides(), *NAMES, dtype=dtype)
    depths = np.concatenate([W * np.array([-1e3, 0.25, 0.5, 1.0, 1.5, 3.0]), np.geomspace(1e-5, 8.0, 40)])
    s = np.concatenate([GAP + depths, -GAP - depths]).astype(dtype)
    rng = np.random.default_rng(0)
    v = rng.uniform(-8.0, 8.0, len(s)).astype(dtype)
    q, rates = (np.repeat(x[:, np.newaxis], kernel.n, axis=1) for x in (s, v))
    found = -kernel.generalized_force(q, rates)
    by_q, by_v, _ = kernel.residual_jacobian(q, rates, np.zeros_like(q))
    elastic, rate, energy = deep(s, v)
    side, slope = np.sign(s), np.clip((np.abs(s.astype(np.longdouble)) - GAP) / W, 0, 1)
    raised = np.maximum(1 + C * rate, 0)
    pushes = np.maximum(elastic * (1 + C * rate) + 1.5 * rate, 0)
    soft = [np.where(s > 0, a, b) for a, b in ((K, 2.0**40), (2.0**40, K))]
    wanted = {
        "clearance": (side * elastic * raised, elastic * C * slope * (raised > 0)),
        "stops": (side * pushes, (elastic * C + 1.5) * slope * (pushes > 0)),
        "stiffness_negative": (soft[0] * s, 0.0 * s),
        "stiffness_positive": (soft[1] * s, 0.0 * s),
        "curve": (PchipInterpolator(*zip(*KNOTS.items(), strict=True))(np.clip(s / W, -2.0, 2.0)), 0.0 * s),
    }
    allowed = 16 * float(np.finfo(dtype).eps)
    deviation = np.abs(s.astype(np.longdouble)) / np.maximum(np.abs(np.abs(s) - GAP), W)  # of the penetration's digits
    for i, (name, (force, damping)) in enumerate(wanted.items()):
        tolerance = allowed * np.maximum(np.abs(force), 1e-30) * (1 + deviation)
        np.testing.assert_array_less(np.abs(found[:, i] - force), tolerance + 1e-30, err_msg=name)
        if name in ("clearance", "stops"):
            tolerance = allowed * (np.abs(damping) + K * W) * (1 + deviation)
            np.testing.assert_array_less(np.abs(by_v[:, i, i] - damping), tolerance, err_msg=name)
    for i in (2, 3):
        np.testing.assert_array_equal(by_q[:, i, i], soft[i - 2])
    stored = kernel.energy(q * (np.arange(kernel.n) < 2), 0.0 * q)[:, 1]
    curve = allowed * 7.0 * W  # that of the curve is a difference of what it has here and at 0
    np.testing.assert_array_less(np.abs(stored - 2 * energy), 3 * allowed * energy * (1 + deviation) + curve)


@pytest.mark.soak
def test_so_they_have_in_journals_couplings_cut_joints_and_cables(built: Build) -> None:
    """Single precision against double: forces 0.3 m deep, with the slopes that derivatives have there."""
    names = (*NAMES, "spring_forces", "cut_forces")
    single, double = (built(everywhere(), *names, dtype=dtype) for dtype in ("float32", "float64"))
    rng = np.random.default_rng(1)
    q = (rng.uniform(0.15, 0.4, (60, double.n)) * rng.choice([-1.0, 1.0], (60, double.n))).astype(np.float32)
    v = rng.uniform(-2.0, 2.0, q.shape).astype(np.float32)
    for name, args in (
        ("generalized_force", (q, v)),
        ("residual_jacobian", (q, v, 0 * v)),
        ("spring_forces", (q, v)),
        ("cut_forces", (q, v)),
        ("energy", (q, v)),
    ):
        found, wanted = getattr(single, name)(*args), getattr(double, name)(*(x.astype(float) for x in args))
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=64 * EPS * np.abs(wanted).max(), err_msg=name)
        assert np.abs(wanted).max() > 100.0
