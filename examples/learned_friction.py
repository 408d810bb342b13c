"""Learn what a model does not know: friction, from a measured motion, with JAX.

    python examples/learned_friction.py

The arm's joints have dry friction, of which its model knows nothing.  A small network of the rates is added to the
drives and trained until the model's accelerations are the measured ones: the gradient goes through the kernel, by its
exact Jacobian, and all samples are one call of C.  What was learned is then used on another motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import eomgen
from eomgen.adapters.jax import function, kernels_for
from eomgen.description import robot_from_toml

ARM = """
name = "rubbing_arm"
gravity = [0.0, 0.0, -9.81]

[[links]]
name = "upper"
mass = 2.0
com = [0.2, 0.0, 0.0]
inertia = { xx = 1e-3, yy = 3e-2, zz = 3e-2 }

[[links]]
name = "fore"
mass = 1.0
com = [0.15, 0.0, 0.0]
inertia = { xx = 1e-3, yy = 1e-2, zz = 1e-2 }

[[joints]]
name = "shoulder"
parent = "base"
child = "upper"
type = "revolute"
gamma = { friction = { coulomb = 0.8, viscous = 0.3, smoothing = 0.2 } }

[[joints]]
name = "elbow"
parent = "upper"
child = "fore"
type = "revolute"
placement = { xyz = [0.4, 0.0, 0.0] }
gamma = { friction = { coulomb = 0.4, viscous = 0.1, smoothing = 0.2 } }
"""

SAMPLES, STEP, HIDDEN, ROUNDS = 400, 5e-3, 8, 600


def without_friction(robot: eomgen.Robot) -> eomgen.Robot:
    joints = []
    for joint in robot.joints:
        table = {name: replace(given, friction=None) for name, given in joint.coordinates.items()}
        joints.append(replace(joint, coordinates=table))
    return replace(robot, name="smooth_arm", joints=tuple(joints))


def measured(kernel: eomgen.Kernel, rng: np.random.Generator) -> tuple[Any, ...]:
    """q, v, drives and accelerations of a motion under drives of some frequencies, with a sensor's noise."""
    t = STEP * np.arange(SAMPLES)[:, None]
    u = sum(rng.uniform(-1.0, 1.0, kernel.n) * [4.0, 1.2] * np.sin(f * t + rng.uniform(0, 6)) for f in (2.0, 5.0, 9.0))
    q, v = (x[:-1] for x in kernel.rollout(np.zeros(kernel.n), np.zeros(kernel.n), u, STEP, SAMPLES))
    return q, v, u, kernel.forward_dynamics(q, v, u) + rng.normal(0.0, 0.02, q.shape)


def network(weights: Any, v: Any) -> Any:
    """Torque per joint, of its rate alone, (n,)."""
    inner = jnp.tanh(weights["slope"] * v[:, None] + weights["shift"])
    return jnp.sum(weights["height"] * inner, axis=1) + weights["linear"] * v


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    robot = robot_from_toml(ARM)
    real = eomgen.build(robot, kernels=("forward_dynamics", "generalized_force", "rollout"))
    model = eomgen.build(without_friction(robot), kernels=kernels_for("forward_dynamics"))
    acceleration = function(model, "forward_dynamics")
    rng = np.random.default_rng(1)
    seen, unseen = measured(real, rng), measured(real, rng)

    def errors(weights: Any, motion: Any) -> Any:
        q, v, u, a = motion
        drives = u + jax.vmap(network, (None, 0))(weights, v)
        return jnp.sqrt(jnp.mean((jax.vmap(acceleration)(q, v, drives) - a) ** 2, axis=0))

    def loss(weights: Any) -> Any:
        return jnp.sum(errors(weights, seen) ** 2)

    shape = (model.n, HIDDEN)
    weights = {name: jnp.asarray(rng.normal(0.0, 1.0, shape)) for name in ("slope", "shift")}
    weights |= {"height": jnp.zeros(shape), "linear": jnp.zeros(model.n)}
    nothing = weights
    step = jax.jit(lambda w, m, s, k: adam(w, m, s, k, jax.grad(loss)(w)))
    mean = square = jax.tree.map(jnp.zeros_like, weights)
    for k in range(ROUNDS):
        weights, mean, square = step(weights, mean, square, k + 1.0)
    for name, motion in (("seen", seen), ("unseen", unseen)):
        before, after = (np.linalg.norm(errors(w, motion)) for w in (nothing, weights))
        print(f"{name} motion: accelerations off by {before:.3f} rad/s^2 rms without friction, {after:.3f} with it")
    still = np.zeros(model.n)
    weight = real.generalized_force(still, still)
    for rate in (-2.0, -0.5, 0.5, 2.0):
        v = np.full(model.n, rate)
        learned, true = network(weights, v), real.generalized_force(still, v) - weight
        words = ", ".join(f"{a:+.2f} ({b:+.2f})" for a, b in zip(learned, true, strict=True))
        print(f"friction at {rate:+.1f} rad/s, learned (true): {words} N m")


def adam(weights: Any, mean: Any, square: Any, k: Any, slope: Any, rate: float = 0.03) -> tuple[Any, Any, Any]:
    """One step of Adam."""
    mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, mean, slope)
    square = jax.tree.map(lambda s, g: 0.999 * s + 0.001 * g * g, square, slope)

    def moved(w: Any, m: Any, s: Any) -> Any:
        return w - rate * (m / (1 - 0.9**k)) / (jnp.sqrt(s / (1 - 0.999**k)) + 1e-8)

    return jax.tree.map(moved, weights, mean, square), mean, square


if __name__ == "__main__":
    main()
