"""What the controller is to do, what its sensors would say, and the drives that it should command: by the host."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import eomgen

ROBOT = "puma560"
GAINS = (400.0, 40.0)  # 1/s^2 and 1/s: critically damped at 20 rad/s
FROM, TO = (0.0, -0.8, 0.3, 0.1, 0.5, -0.2), (1.2, 0.2, -0.6, 1.0, -0.4, 0.9)  # rad
LATE = 0.02  # rad: what every joint is off at first
STICKY = 1.2  # damping of the arm by that of the controller's model
RATE, DURATION = 1000, 1.0  # steps a second; s
EVERY = 10  # one of so many steps is given to the firmware


@dataclass(frozen=True)
class Task:
    """Parameters of the model, and the closed loop as the host simulates it, one row per step given to the firmware.

    q, v: rad and rad/s, what sensors would say.  u: N m, the drives of the kernel here, float32.
    exact: the same in float64.  error: rad, the greatest of a joint at each step.
    """

    parameters: list[float]
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    exact: np.ndarray
    error: np.ndarray

    def header(self) -> str:
        """task.h, with numbers to the bit."""
        steps, n = self.q.shape
        values = {"parameters": self.parameters, "kp": [GAINS[0]] * n, "kd": [GAINS[1]] * n, "from": FROM, "to": TO}
        lines = [
            "/* Written by build.py. */",
            f"enum {{ STEPS = {steps} }};",
            f"static const float period = {_literal(EVERY / RATE)}, duration = {_literal(DURATION)};",
            *(f"static const float {name}[] = {_literal(value)};" for name, value in values.items()),
        ]
        for name, states in (("q", self.q), ("v", self.v)):
            lines.append(f'__attribute__((section(".states"))) static const float {name}[{steps}][{n}] =')
            lines.append("    { " + ",\n      ".join(_literal(state) for state in states) + " };")
        return "\n".join(lines) + "\n"


def _literal(values: Any) -> str:
    if np.ndim(values):
        return "{ " + ", ".join(_literal(value) for value in values) + " }"
    return f"{float(np.float32(values)).hex()}f"


def goal(t: Any, dtype: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations that are wanted at the time t: in the order of controller.c."""
    one, length = dtype(1), dtype(DURATION)
    x, rate = t / length if t < length else one, one / length
    start = np.array(FROM, dtype)
    distance = np.array(TO, dtype) - start
    s = x * x * x * (dtype(10) + x * (dtype(6) * x - dtype(15)))
    s_dot = dtype(30) * x * x * (one + x * (x - dtype(2))) * rate
    s_ddot = dtype(60) * x * (one + x * (dtype(2) * x - dtype(3))) * rate * rate
    return start + s * distance, s_dot * distance, s_ddot * distance


def drives(model: eomgen.Kernel, step: int, q: np.ndarray, v: np.ndarray, dtype: Any = np.float32) -> np.ndarray:
    """Computed torque: the law of controller.c in NumPy around a kernel of that dtype."""
    wanted, faster, a = goal(time(step, dtype), dtype)
    kp, kd = map(dtype, GAINS)
    return np.asarray(model.inverse_dynamics(q, v, a + kd * (faster - v) + kp * (wanted - q)))


def time(step: int, dtype: Any) -> Any:
    """Seconds, rounded as main.c does at the steps that the firmware gets."""
    return dtype(step / EVERY) * dtype(EVERY / RATE)


def simulated() -> Task:
    """The arm under this controller, with more damping than the controller knows of and off its course at first."""
    robot = eomgen.load_robot(ROBOT)
    model = eomgen.build(robot, kernels=("inverse_dynamics",), dtype="float32")
    exact = eomgen.build(robot, kernels=("inverse_dynamics",))
    arm = eomgen.build(robot, kernels=("forward_dynamics", "rollout"))
    for name in arm.parameters:
        if name.endswith(".damping"):
            arm.parameters[name] *= STICKY
    q, v = np.array(FROM) + LATE, np.zeros(arm.n)
    rows = []
    for step in range(int(RATE * DURATION)):
        measured = q.astype(np.float32), v.astype(np.float32)
        u = drives(model, step, *measured)
        if step % EVERY == 0:
            error = np.abs(q - goal(time(step, np.float64), np.float64)[0]).max()
            double = (x.astype(np.float64) for x in measured)
            rows.append((*measured, u, drives(exact, step, *double, dtype=np.float64), error))
        q, v = (x[-1] for x in arm.rollout(q, v, u.astype(float), 1.0 / RATE, 1))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Task([float(model.parameters[name]) for name in model.parameters], *columns)
