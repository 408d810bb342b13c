"""Reference of the Python interface: one page per subject, filled from docstrings by mkdocstrings."""

from __future__ import annotations

import eomgen

# What stands on which page: modules, all of whose public names are shown.
PAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "api_robots": ("Robots and their parts", ("eomgen.robot", "eomgen.description", "eomgen.sensitivity")),
    "api_simulation": (
        "Simulation",
        (
            *("eomgen.simulate", "eomgen.scenario", "eomgen.scenario_file", "eomgen.integrate", "eomgen.motion"),
            *("eomgen.result", "eomgen.balance", "eomgen.result_file", "eomgen.stream"),
        ),
    ),
    "api_loops": ("Closed loops", ("eomgen.loops", "eomgen.loop_motion")),
    "api_analysis": (
        "Analysis",
        (
            *("eomgen.analysis", "eomgen.fitting", "eomgen.compare", "eomgen.deflection", "eomgen.compliance"),
            *("eomgen.modes", "eomgen.response", "eomgen.linearize", "eomgen.budget"),
        ),
    ),
    "api_adapters": (
        "Optimal control and learning",
        ("eomgen.adapters.mappings", "eomgen.adapters.casadi", "eomgen.adapters.jax"),
    ),
    "api_sweeps": ("Sweeps", ("eomgen.sweep", "eomgen.sweep_plan", "eomgen.sweep_result")),
    "api_pictures": (
        "Pictures",
        ("eomgen.plots", "eomgen.robot_plots", "eomgen.zero_plots", "eomgen.report", "eomgen.scene"),
    ),
}
ERRORS = tuple(name for name in eomgen.__all__ if name.endswith("Error"))


def main_page() -> str:
    """What ``import eomgen`` gives, kernels first, with links to the other pages."""
    rest = [name for name in eomgen.__all__ if name not in (*ERRORS, "Kernel", "__version__")]
    shown = ["Kernel", *(name for name in rest if not isinstance(getattr(eomgen, name), type))]
    links = [
        f"- [{title}]({name}.md): {', '.join(f'`{m}`' for m in modules)}" for name, (title, modules) in PAGES.items()
    ]
    lines = [
        "# Python interface",
        "",
        "What `import eomgen` gives; written from the docstrings. Arrays are (n,) or (N, n), SI units and radians. "
        "Values of a robot (`Robot`, `Joint`, ...) are described in [Robots and their parts](api_robots.md).",
        "",
        *links,
        "",
        *_shown(shown, "eomgen"),
        "## Errors",
        "",
        *_shown(ERRORS, "eomgen"),
    ]
    return "\n".join(lines)


def pages() -> dict[str, str]:
    """The pages by their names without ending."""
    found = {}
    for name, (title, modules) in PAGES.items():
        lines = [f"# {title}", ""]
        for module in modules:
            lines += [f"::: {module}", "    options:", "      heading_level: 2", "      members_order: source", ""]
        found[name] = "\n".join(lines)
    return found


def _shown(names: tuple[str, ...] | list[str], where: str) -> list[str]:
    return [line for name in names for line in (f"::: {where}.{name}", "")]
