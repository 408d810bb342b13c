"""The gradient of a rollout: ours in C, MuJoCo's transition matrices by differences, JAX through our kernels.

All take turns in one process.  Errors are those beside central differences of the same steps, of fourth order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.adapters.mappings import kernels_for
from eomgen.bench.beside import processor_name

from .cases import ELASTIC, Case, case
from .contender import MissingPeer
from .measure import states
from .mujoco_peer import MujocoPeer
from .python_calls import least
from .report import Gradient

Array = NDArray[np.float64]
Derivatives = tuple[Array, Array, Array]  # by q, by v (n,), by the drives (steps, n)

ROBOTS = ("UR5", ELASTIC)
STIFF = (ELASTIC,)  # explicit steps of 1 ms do not come to an end
OURS = {"eomgen `rk4`": "rk4", "eomgen `implicit`": "implicit"}
DIFFERENCES = {"MuJoCo `discrete`, forward": False, "MuJoCo `discrete`, centered": True}
THROUGH = "JAX, `rk4` of our forward dynamics"
ADAPTER = "JAX, our rollout by `implicit`"
SCHEME = {**OURS, **dict.fromkeys(DIFFERENCES, "implicit"), THROUGH: "rk4", ADAPTER: "implicit"}
DT, STEPS, EPS = 1e-3, 100, 1e-6
APART = (1e-3, 1.0)  # m or rad, m/s or rad/s; N or Nm: between the states, and the drives, of differences
PLACES, FACTORS = (-2.0, -1.0, 1.0, 2.0), (1.0 / 12.0, -8.0 / 12.0, 8.0 / 12.0, -1.0 / 12.0)
DRIVES = 4  # steps whose drives errors are taken of


def gradients(
    rounds: int, robots: Sequence[str] = ROBOTS, steps: int = STEPS
) -> tuple[tuple[Gradient, ...], list[str]]:
    """Return least times and errors of all ways, and why others are missing.

    Raises:
        MissingPeer: a robot is of example-robot-data, which is not installed.
    """
    measured, missing = [], dict[str, None]()
    for key in robots:
        chosen = case(key)
        task, calls = Task(chosen, steps), dict[str, Callable[[], Derivatives]]()
        calls |= {label: task.ours(method) for label, method in OURS.items()}
        for make in (task.mujoco, task.jax):
            try:
                calls |= make()
            except MissingPeer as error:
                missing[str(error)] = None
        calls = {label: call for label, call in calls.items() if not (key in STIFF and SCHEME[label] == "rk4")}
        errors = {label: task.error(call(), SCHEME[label]) for label, call in calls.items()}
        ns = least(calls, rounds)
        measured.append(Gradient(chosen.title, processor_name(), steps, ns, errors))
    return tuple(measured), list(missing)


class Task:
    """The derivatives of w . q after some steps of a robot, by where it begins and all drives."""

    def __init__(self, chosen: Case, steps: int) -> None:
        self.robot, self.steps = chosen.robot, steps
        inputs = states(chosen.robot, steps)
        self.q, self.v, self.u, self.w = 0.5 * inputs["q"][0], 0.1 * inputs["v"][0], 0.2 * inputs["u"], inputs["w"][0]
        kernels = (*kernels_for("forward_dynamics", order=1), "rollout", "explicit_gradient", "implicit_gradient")
        self.kernel = eomgen.build(chosen.robot, kernels=kernels, native=True)
        self._exact: dict[str, Array] = {}

    def ours(self, method: str) -> Callable[[], Derivatives]:
        """Return ``rollout_gradient``, from Python."""

        def loss(t: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
            by_q = np.zeros_like(q)
            by_q[-1] = self.w
            return float(self.w @ q[-1]), by_q, np.zeros_like(v)

        def call() -> Derivatives:
            by = self.kernel.rollout_gradient(self.q, self.v, self.u, DT, self.steps, loss=loss, method=method)[1]
            return by["q"], by["v"], by["u"]

        return call

    def mujoco(self) -> Mapping[str, Callable[[], Derivatives]]:
        """Return transition matrices by finite differences in every step, chained backwards.

        Raises:
            MissingPeer: MuJoCo cannot be had, or not for this robot.
        """
        peer = MujocoPeer(self.robot, actuators=True)
        return {
            label: peer.gradient(self.q, self.v, self.u, self.w, DT, eps=EPS, centered=centered)
            for label, centered in DIFFERENCES.items()
        }

    def jax(self) -> Mapping[str, Callable[[], Derivatives]]:
        """Return JAX's reverse mode through the adapter: of a scan of steps, and of a whole rollout.

        Raises:
            MissingPeer: JAX is not installed.
        """
        try:
            import jax
            import jax.numpy as jnp
        except ImportError:
            raise MissingPeer("the wheel jax is not installed") from None
        from eomgen.adapters.jax import function, rollout

        jax.config.update("jax_enable_x64", True)
        accelerations = function(self.kernel, "forward_dynamics")
        whole = rollout(self.kernel, DT, self.steps, every=self.steps, method="implicit")

        def slope(q: object, v: object, u: object) -> tuple[object, object]:
            return v, accelerations(q, v, u)

        def step(state: tuple[object, ...], u: object) -> tuple[tuple[object, ...], None]:
            rates = [slope(*state, u)]
            for share in (0.5, 0.5, 1.0):
                rates.append(slope(*(x + share * DT * dx for x, dx in zip(state, rates[-1], strict=True)), u))
            sums = [a + 2 * b + 2 * c + d for a, b, c, d in zip(*rates, strict=True)]
            return tuple(x + DT / 6 * dx for x, dx in zip(state, sums, strict=True)), None

        def end_of_steps(q: object, v: object, u: object) -> object:
            return self.w @ jax.lax.scan(step, (q, v), u)[0][0]

        def end_of_rollout(q: object, v: object, u: object) -> object:
            return self.w @ whole(q, v, u)[0][-1]

        inputs = [jnp.asarray(x) for x in (self.q, self.v, self.u)]

        def call_of(end: Callable[..., object]) -> Callable[[], Derivatives]:
            compiled = jax.jit(jax.grad(end, argnums=(0, 1, 2)))

            def call() -> Derivatives:
                by_q, by_v, by_u = (np.asarray(x) for x in compiled(*inputs))
                return by_q, by_v, by_u

            return call

        return {THROUGH: call_of(end_of_steps), ADAPTER: call_of(end_of_rollout)}

    def error(self, derivatives: Derivatives, method: str) -> float:
        """Return the greatest relative error (max-norm) of the derivatives by q, by v and by drives of some steps."""
        if method not in self._exact:
            self._exact[method] = self._differences(method)
        exact, (by_q, by_v, by_u) = self._exact[method], derivatives
        wrong = np.vstack([by_q, by_v, by_u[self._told()]]) - exact
        kinds = slice(0, 1), slice(1, 2), slice(2, None)
        return max(float(np.abs(wrong[kind]).max() / max(np.abs(exact[kind]).max(), 1e-300)) for kind in kinds)

    def _told(self) -> list[int]:
        """Return steps whose drives are looked at."""
        return [round(i * (self.steps - 1) / (DRIVES - 1)) for i in range(DRIVES)]

    def _differences(self, method: str) -> Array:
        """Return derivatives by q, v and drives of some steps, rows of (n,), from rollouts of the same steps."""
        arrays, n = [np.vstack([self.q, self.v]), self.u], len(self.q)
        rows = [(0, 0), (0, 1), *((1, step) for step in self._told())]
        moved = list(self._moved(arrays, rows))
        q, v, u = (np.array([x[i] for x in moved]) for i in range(3))
        ends = self.kernel.rollout(q, v, u, DT, self.steps, method=method, every=self.steps)[0][:, -1] @ self.w
        return (ends.reshape(len(rows), n, len(PLACES)) @ np.array(FACTORS)) / [[APART[array]] for array, _ in rows]

    @staticmethod
    def _moved(arrays: Sequence[Array], rows: Sequence[tuple[int, int]]) -> Iterator[tuple[Array, Array, Array]]:
        """Yield beginnings and drives with one number changed, in all places of a difference."""
        for array, row in rows:
            for i in range(arrays[0].shape[1]):
                for place in PLACES:
                    start, u = arrays[0].copy(), arrays[1].copy()
                    (start, u)[array][row, i] += place * APART[array]
                    yield start[0], start[1], u
