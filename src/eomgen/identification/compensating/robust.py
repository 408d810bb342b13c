"""Compensated paths on robots whose stiffness is not what the description says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...arrays import Array
from ...errors import InputError, IntegrationError
from ...progress import Progress
from .reach import tool_error
from .result import Variant, sizes
from .setting import Setting

STIFFNESS = ".stiffness"  # at the end of a parameter's name


def variants(setting: Setting, samples: Array, wrong: float, draws: int, seed: int, report: Progress) -> list[Variant]:
    """Return the tool's error without and with a correction on robots whose stiffnesses are wrong by a share.

    All of them are softer, then stiffer; then each is one of both by chance.

    Args:
        setting: the task.
        samples: the compensated path, (T, m).
        wrong: the share, between 0 and 1.
        draws, seed: of the signs by chance.
        report: told how far it has come.

    Raises:
        InputError: the robot has no stiffness that is a run-time parameter.
        IntegrationError: such a robot does not come to the end of the motion; says which.
    """
    names = [name for name in setting.assembly.kernel.parameters if name.endswith(STIFFNESS)]
    if not names:
        raise InputError(
            f"robustness: {setting.robot.name} has no stiffness; allowed: with a robot whose joints, transmissions or"
            " springs have one"
        )
    rows = []
    for k, (label, signs) in enumerate(_signs(len(names), wrong, draws, seed)):
        report(k / (draws + 2), f"{label} stiffness")
        numbers = setting.assembly.kernel.parameters
        changed = {name: numbers[name] * (1.0 + wrong * sign) for name, sign in zip(names, signs, strict=True)}
        try:
            errors = [tool_error(setting.want, setting.run(x, changed).pose) for x in (None, samples)]
        except IntegrationError as error:
            raise IntegrationError(f"robustness: {label} stiffness: {error}") from None
        rows.append(Variant(label, *(rms for error in errors for rms in sizes(error)[0])))
    return rows


def _signs(count: int, wrong: float, draws: int, seed: int) -> Iterator[tuple[str, list[float]]]:
    yield f"{-100.0 * wrong:g} %", [-1.0] * count
    yield f"+{100.0 * wrong:g} %", [1.0] * count
    random = np.random.default_rng(seed)
    for k in range(draws):
        yield f"+-{100.0 * wrong:g} % by chance, {k + 1}", random.choice([-1.0, 1.0], count).tolist()
