"""Records of random arms with joint noise, made without eomgen's identification: truths to be found again.

Motions are periodic, so that deflections of transmissions and all derivatives follow from Fourier series exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.robot.value import Coordinate, Friction, Joint, Link, Motor, Placement, Robot

Array = NDArray[np.float64]
SMOOTHING = 1e-9


@dataclass(frozen=True)
class BlindArm:
    """An arm of two links behind elastic transmissions: a rigid one with its numbers, and the numbers of the motors."""

    rigid: Robot
    motors: tuple[Motor, ...]

    @property
    def elastic(self) -> Robot:
        joints = [replace(joint, motor=motor) for joint, motor in zip(self.rigid.joints, self.motors, strict=True)]
        return replace(self.rigid, name="elastic", joints=tuple(joints))


def blind_arm(seed: int, stiffness: tuple[float, float] = (3e3, 3e4)) -> BlindArm:
    rng = np.random.default_rng(seed)
    links, joints = [], []
    for i, length in enumerate(rng.uniform(0.25, 0.5, 2)):
        mass, com = rng.uniform(1.0, 6.0), rng.uniform(-0.05, 0.05, 3) + [length / 2, 0.0, 0.0]
        own = rng.uniform(0.01, 0.08, 3) + 0.03
        links.append(Link(f"link{i + 1}", mass, tuple(com.tolist()), (*own.tolist(), 0.001, -0.002, 0.001)))
        placed = Placement.from_dh(0.0 if not i else 0.35, 0.0 if not i else np.pi / 2, 0.1 * i, 0.0)
        parent = f"link{i}" if i else "base"
        coordinates = {"gamma": Coordinate()}
        joints.append(Joint(f"joint{i + 1}", parent, f"link{i + 1}", "revolute", placed, coordinates=coordinates))
    low, high = np.log(stiffness)
    motors = tuple(
        Motor(
            float(rng.uniform(2e-4, 6e-4)),
            float(rng.uniform(50.0, 120.0)),
            Coordinate(stiffness=float(np.exp(rng.uniform(low, high))), damping=float(rng.uniform(1.0, 6.0))),
            Friction(coulomb=float(rng.uniform(0.03, 0.1)), viscous=1e-3, smoothing=SMOOTHING),
        )
        for _ in range(2)
    )
    rigid = Robot("rigid", (0.0, -9.81, 0.0), tuple(links), tuple(joints))
    return BlindArm(rigid, motors)


def periodic(seed: int, samples: int, step: float, columns: int = 2) -> tuple[Array, Array, Array, Array]:
    """Times, and a periodic motion with rates and accelerations, (T, columns)."""
    rng = np.random.default_rng(seed)
    t = step * np.arange(samples)
    base = 2.0 * np.pi / (samples * step)
    q, v, a = (np.zeros((samples, columns)) for _ in range(3))
    for i in range(columns):
        for k in rng.choice(np.arange(1, 14), 6, replace=False):
            w, phase, size = k * base, rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 0.8) / np.sqrt(k)
            q[:, i] += size * np.sin(w * t + phase)
            v[:, i] += size * w * np.cos(w * t + phase)
            a[:, i] -= size * w * w * np.sin(w * t + phase)
    return t, q, v, a


def record(
    arm: BlindArm,
    inverse: Callable[[Array, Array, Array], Array],
    seed: int,
    *,
    noise: float,
    force_noise: float = 0.0,
    samples: int = 4000,
    step: float = 1e-3,
) -> MeasuredMotion:
    """A record of joints, shafts and drives.

    Args:
        arm: of which.
        inverse: inverse dynamics of the rigid arm.
        seed: of motion and noise.
        noise: standard deviation of every encoder, of joints and of shafts, rad.
        force_noise: of the drives, N m at the shaft.
        samples, step: of the record.
    """
    t, q, v, a = periodic(seed, samples, step)
    force = np.asarray(inverse(q, v, a))
    waves = 2j * np.pi * np.fft.rfftfreq(samples, step)[:, None]
    k, d = (np.array([getattr(motor.transmission, key) for motor in arm.motors]) for key in ("stiffness", "damping"))
    spectrum = np.fft.rfft(force, axis=0) / (k + d * waves)
    bent, bent_rate, bent_slope = (np.fft.irfft(spectrum * waves**order, samples, axis=0) for order in range(3))
    ratio = np.array([motor.ratio for motor in arm.motors])
    inertia = np.array([motor.inertia for motor in arm.motors])
    shaft, rate, slope = ratio * (q + bent), ratio * (v + bent_rate), ratio * (a + bent_slope)
    dry = np.array([motor.friction.coulomb for motor in arm.motors if motor.friction])
    viscous = np.array([motor.friction.viscous for motor in arm.motors if motor.friction])
    drive = inertia * slope + dry * rate / np.hypot(rate, SMOOTHING) + viscous * rate + force / ratio
    rng = np.random.default_rng(seed + 1000)
    columns = {"t": t}
    for i in range(2):
        columns[f"joint{i + 1}.gamma"] = q[:, i] + noise * rng.standard_normal(samples)
        columns[f"joint{i + 1}.motor"] = shaft[:, i] + noise * rng.standard_normal(samples)
        columns[f"joint{i + 1}.motor.drive"] = drive[:, i] + force_noise * rng.standard_normal(samples)
    return motion_from_columns(columns, eomgen.robot.model.build_model(arm.elastic).coordinates)
