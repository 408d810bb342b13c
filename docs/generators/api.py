"""Reference of the Python interface: one page per subject, filled from docstrings by mkdocstrings."""

from __future__ import annotations

import eomgen

# What stands on which page: modules, all of whose public names are shown.
PAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "api_robots": ("Robots and their parts", ("eomgen.robot", "eomgen.description", "eomgen.analysis.sensitivity")),
    "api_simulation": (
        "Simulation",
        (
            *(
                "eomgen.simulation.run",
                "eomgen.scenario",
                "eomgen.scenario.load",
                "eomgen.integration.solve",
                "eomgen.motion",
            ),
            *(
                "eomgen.simulation.result",
                "eomgen.simulation.balance",
                "eomgen.simulation.stream",
            ),
        ),
    ),
    "api_loops": ("Closed loops", ("eomgen.loops", "eomgen.integration.closed")),
    "api_analysis": (
        "Analysis",
        (
            *(
                "eomgen.identification.from_motion",
                "eomgen.identification.least_squares",
                "eomgen.analysis.structures",
                "eomgen.analysis.statics",
                "eomgen.analysis.compliance",
            ),
            *(
                "eomgen.analysis.modal",
                "eomgen.analysis.frequency",
                "eomgen.analysis.matrices",
                "eomgen.analysis.tool_budget",
            ),
        ),
    ),
    "api_adapters": (
        "Optimal control and learning",
        ("eomgen.adapters.mappings", "eomgen.adapters.casadi", "eomgen.adapters.jax"),
    ),
    "api_sweeps": ("Sweeps", ("eomgen.sweep", "eomgen.sweep.plan", "eomgen.sweep.result")),
    "api_pictures": (
        "Pictures",
        (
            "eomgen.pictures.simulation",
            "eomgen.pictures.robot",
            "eomgen.pictures.zeros",
            "eomgen.pictures.page",
            "eomgen.pictures.scene",
        ),
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
