"""Plans of sweeps that the reader refuses."""

from __future__ import annotations

from tests.support.sliders import STIFF

UNIFORM = "uniform = { low = 1.0, high = 2.0 }\n"
GRID = "grid = { values = [1.0, 2.0] }\n"

BAD = {  # text of a plan, and parts of the message
    "samples = 2": ("vary", "missing"),
    "vary = 3": ("vary", "3", "[[vary]]"),
    "vary = []": ("vary", "one or more"),
    f"sample = 2\n{STIFF}{UNIFORM}": ("sample", "did you mean 'samples'"),
    f"{STIFF}{UNIFORM}": ("samples", "missing"),
    f"samples = 0\n{STIFF}{UNIFORM}": ("samples", "0", "from 1"),
    f"samples = 2.5\n{STIFF}{UNIFORM}": ("samples", "2.5", "whole number"),
    f"samples = 2\n{STIFF}{GRID}": ("samples", "grids alone"),
    f"samples = 2\nseed = -1\n{STIFF}{UNIFORM}": ("seed", "-1", "from 0"),
    f"samples = 2\ndesign = 'sobol'\n{STIFF}{UNIFORM}": ("design", "sobol", "latin_hypercube"),
    f"record = []\n{STIFF}{GRID}": ("record", "one or more"),
    f"record = ['tool_deviation']\n{STIFF}{GRID}": ("record", "tool_deviation", "did you mean"),
    f"[engine]\ntype = 'gpu'\n{STIFF}{GRID}": ("engine.type", "gpu", "rollout"),
    f"[engine]\nmethod = 'rk4'\n{STIFF}{GRID}": ("engine.method", "[integrator]"),
    f"[engine]\nstep = 1e-3\n{STIFF}{GRID}": ("engine.step", "rtol"),
    f"[engine]\ntype = 'rollout'\nperiod = 1e-3\n{STIFF}{GRID}": ("engine.period", "[integrator]"),
    f"[engine]\nsteps = 3\n{STIFF}{GRID}": ("engine", "unknown key", "type"),
    f"[[vary]]\n{GRID}": ("vary[0]", "parameter or scenario"),
    f"[[vary]]\nparameter = 'gravity.x'\nscenario = 'duration'\n{GRID}": ("vary[0]", "one of them"),
    f"{STIFF}": ("vary[0]", "one distribution", "none"),
    f"samples = 2\n{STIFF}{UNIFORM}{GRID}": ("vary[0]", "grid, uniform"),
    f"samples = 2\n{STIFF}uniform = {{ low = 2.0, high = 2.0 }}": ("vary[0].uniform.high", "greater than low"),
    f"samples = 2\n{STIFF}uniform = {{ low = 2.0 }}": ("vary[0].uniform", "'high' is missing"),
    f"samples = 2\n{STIFF}normal = {{ mean = 2.0, deviation = 0.0 }}": ("vary[0].normal.deviation", "greater than 0"),
    f"samples = 2\n{STIFF}normal = {{ mean = 0.0, deviation = 1.0, low = 9.0 }}": (
        "vary[0].normal.low",
        "8 deviations",
    ),
    f"{STIFF}grid = {{ values = [1.0, 'a'] }}": ("vary[0].grid.values.1", "'a'", "finite number"),
    f"{STIFF}grid = {{ values = [1.0, 1.0] }}": ("vary[0].grid.values", "different"),
    f"{STIFF}grid = {{ values = [1.0], count = 3 }}": ("vary[0].grid.count", "values, or low"),
    f"{STIFF}grid = {{ low = 1.0, high = 2.0, count = 1 }}": ("vary[0].grid.count", "from 2"),
    f"{STIFF}{GRID}{STIFF}{GRID}": ("vary[1]", "vary[0]", "once"),
}
