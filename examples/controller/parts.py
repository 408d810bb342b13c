"""Count instructions of the parts of a loop on a Cortex-M7: python examples/controller/parts.py --write.

Feed-forward of a 6R arm with elastic gears, momentum observer, Kalman filters: in float, without a board.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from calls import instructions, is_here, linked
from image import Image

import eomgen
from eomgen.control import MomentumObserver, observer
from eomgen.control.feedforward_source import feedforward_files
from eomgen.control.momentum_observer import KERNELS
from eomgen.control.observer_source import observer_files
from eomgen.motion import PointToPoint
from eomgen.pipeline import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.value import Coordinate, Motor, Robot

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"
BEGIN, END = "<!-- begin of parts -->\n", "<!-- end of parts -->"
ARM, OBSERVED = "ur5", "puma560"
STIFFNESS = (2e4, 2e4, 1.5e4, 5e3, 5e3, 3e3)  # N m/rad, of gears
RATIO = 100.0
DT = 1e-3  # s
SAMPLES = 20  # along a motion
GEARS: dict[str, Callable[[float], Coordinate]] = {
    "linear springs": Coordinate,
    "cubic springs": lambda k: Coordinate(k, cubic=1e5 * k),
    "linear springs and dampers": lambda k: Coordinate(k, 1e-3 * k),
}
STEP = """#include "{name}_feedforward.h"
static {name}_feedforward memory;
static const float series[{samples}][{size}] = {{
{rows}
}};
static float q[{m}], v[{m}], u[{m}];
static int k, status;
void setup(void) {{ {name}_feedforward_setup(&memory); }}
void sample(void) {{ status |= {name}_feedforward_step(&memory, series[k++], q, v, u); }}
void reset(void) {{ setup(); sample(); }}
"""
MOMENTUM = """#include "{name}_momentum_observer.h"
static {name}_momentum_observer memory;
static const float states[{samples}][{size}] = {{
{rows}
}};
static const float p[] = {{ {parameters} }};
static float h[{hoisted}], u[{n}];
static int k, status;
void setup(void) {{ {name}_setup(p, h); (void){name}_momentum_observer_start(h, states[0], &states[0][{n}], &memory); }}
void sample(void) {{ status |= {name}_momentum_observer_step(h, states[k], &states[k][{n}], u, &memory); ++k; }}
void reset(void) {{ setup(); sample(); }}
"""
FILTER = """#include "{name}_observer.h"
static {name}_observer memory;
static float q[{n}], v[{n}], u[{n}], y[{n}];
static int status;
void setup(void) {{ {name}_observer_setup(&memory, q, v); }}
void sample(void) {{ status |= {name}_observer_predict(&memory, u); (void){name}_observer_update(&memory, y); }}
void reset(void) {{ setup(); sample(); }}
"""


def elastic_arm(gear: str) -> Robot:
    """The arm with a motor behind an elastic gear at every joint."""
    robot = eomgen.load_robot(ARM)
    joints = (
        replace(joint, motor=Motor(1e-4, RATIO, GEARS[gear](k)))
        for joint, k in zip(robot.joints, STIFFNESS, strict=True)
    )
    return replace(robot, name="elastic_arm", joints=tuple(joints))


def along(order: int) -> np.ndarray:
    """A motion of six joints and its time derivatives up to an order, one row of all for each sample."""
    course = PointToPoint(np.zeros(6), np.linspace(0.8, -0.4, 6), 0.5, smooth=4)
    return np.concatenate(course.series(0.1 + DT * np.arange(SAMPLES), order), axis=-1)


def _rows(values: np.ndarray) -> str:
    return ",\n".join("    { " + ", ".join(f"{float(np.float32(x)).hex()}f" for x in row) + " }" for row in values)


def of_feedforward(gear: str) -> tuple[Mapping[str, str], str]:
    """Texts of a feed-forward, and what calls it."""
    robot = elastic_arm(gear)
    values = along(3 if "damper" in gear else 4)
    entry = STEP.format(name=robot.name, samples=SAMPLES, size=values.shape[1], rows=_rows(values), m=6)
    return feedforward_files(robot, dt=DT, dtype="float32"), entry


def of_momentum_observer() -> tuple[Mapping[str, str], str]:
    """The same of a momentum observer."""
    robot = eomgen.load_robot(OBSERVED)
    found = MomentumObserver(robot, 50.0, DT, threshold=15.0, dtype="float32")
    source = make_source(robot, Options(KERNELS, "float32", batches=False))
    hoisted = re.search(r"_HOISTED (\d+)", source.files[f"{OBSERVED}.h"])
    assert hoisted is not None
    values = along(1)
    parameters = ", ".join(f"{x!r}f" for x in found.kernel.parameters.values())
    about = {"name": OBSERVED, "samples": SAMPLES, "size": values.shape[1], "rows": _rows(values), "n": 6}
    entry = MOMENTUM.format(**about, parameters=parameters, hoisted=hoisted[1])
    return {**source.files, **found.sources()}, entry


def of_filter(form: str) -> tuple[Mapping[str, str], str]:
    """The same of a Kalman filter with an encoder at every joint."""
    sensors = [f"encoder:joint{i}.gamma" for i in range(1, 7)]
    made = observer(OBSERVED, sensors, dt=DT, form=form, dtype="float32")  # type: ignore[arg-type]
    return observer_files(made), FILTER.format(name=OBSERVED, n=6)


PARTS: dict[str, Callable[[], tuple[Mapping[str, str], str]]] = {
    **{f"feed-forward, `{ARM}`, elastic gears: {gear}": partial(of_feedforward, gear) for gear in GEARS},
    f"momentum observer, `{OBSERVED}`": of_momentum_observer,
    f"Kalman filter, `{OBSERVED}`, 6 encoders, covariance": partial(of_filter, "covariance"),
    f"Kalman filter, `{OBSERVED}`, 6 encoders, square root": partial(of_filter, "square_root"),
}


def counted(part: str) -> tuple[list[int], int]:
    """Instructions of each sample behind the first, and bytes of the struct."""
    files, entry = PARTS[part]()
    with TemporaryDirectory() as name:
        path = linked(files, entry, Path(name))
        counts = instructions(path, ("setup", *["sample"] * SAMPLES))
        size = next(symbol.size for symbol in Image(path).symbols() if symbol.name == "memory")
    return counts[2:], size


def table() -> str:
    """The figures of the page."""
    rows = ["| part | instructions of a sample: least / mean / most | struct, bytes |", "| --- | ---: | ---: |"]
    for part in PARTS:
        counts, size = counted(part)
        rows.append(f"| {part} | {min(counts)} / {np.mean(counts):.0f} / {max(counts)} | {size} |")
    return "\n".join(rows) + "\n"


def filled(text: str, figures: str) -> str:
    """The page with its figures."""
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    return text[:begin] + figures + text[end:]


def write() -> None:
    """Put the figures into the page."""
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), table()), encoding="utf-8")


def main() -> None:
    """Count and print, or write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put the figures into docs/controllers.md")
    if not is_here():
        raise SystemExit("zig and unicorn are needed: pip install eomgen[compiler] unicorn")
    if parser.parse_args().write:
        write()
    else:
        print(table())


if __name__ == "__main__":
    main()
