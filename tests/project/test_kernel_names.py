"""The names of kernels are known to their table and to what writes a certain kernel, and to no other module."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from eomgen.codegen.kernels.signatures import KERNELS, SIGNATURES

ROOT = Path(__file__).resolve().parents[2]
GROUPS = "kernels.groups"  # ends the name of the module that has names by purpose
NAMES = {*KERNELS.compiled, *SIGNATURES, *(name for signature in KERNELS.values() for name in signature.functions)}
KNOWN = {  # modules that have names, and why
    "codegen/kernels/": "the table and the writers",
    "codegen/c/contexts.py": "what templates of composed kernels are rendered with",
    "codegen/closed_form/trace.py": "equations of M and C as traces",
    "codegen/joint/zero_listing.py": "zeros of M and C",
    "codegen/joint/zeros.py": "zeros of M and C",
    "src/eomgen/bench/textbook.py": "the textbook's algorithms for the same quantities, in C",
    "src/eomgen/kernel/stepping/input_signals.py": "members of C structures that hold functions",
    "src/eomgen/kernel/stepping/packed_inputs.py": "members of C structures that hold functions",
    "src/eomgen/kernel/stepping/options.py": "table of the methods of rollouts",
}
OTHERS = {  # words that are names of kernels, too, and what they mean elsewhere
    "constraint": "what has names in headers",
    "cut_poses": "array",
    "energy": "figure or column of a simulation",
    "following": "array of the function that solves for dependent coordinates",
    "gravity": "parameter, key of a description or of a controller",
    "imu": "kind of a sensor",
    "loop_reactions": "column of forces along a motion",
    "reactions": "column of forces along a motion, variable of an FMU",
    "regressor": "array",
    "residual": "what equations leave",
    "rollout": "kind of kernels, engine of sweeps, method of kernels in messages",
    "settling": "array",
}
WHERE = {  # modules in which they mean that
    "constraint": ("codegen/c/names.py",),
    "energy": (
        *("analysis/modal_result", "export/fmu/variables", "integration/trajectory", "pictures/page_figures"),
        *("results/beside", "simulation/contents", "simulation/result", "simulation/segments"),
    ),
    "following": ("loops/chart",),
    "gravity": (
        *("analysis/statics", "control/observer_source", "description/keys", "description/load"),
        *("description/mjcf/compiling", "description/mjcf/read", "export/fmu/variables", "export/live/acting"),
        *("export/live/sliders", "export/mujoco", "identification/tolerances/bending", "robot/model"),
        *("robot/parameter_names", "robot/value/robot", "scenario/keys", "simulation/assembly"),
        *("codegen/closed_form/readable.py", "codegen/tree/bound.py"),
    ),
    "imu": ("control/sensing", "robot/value/sensor", "robot/value/sensor_readings"),
    "cut_poses": ("codegen/c/names.py",),
    "loop_reactions": ("identification/from_motion", "codegen/c/names.py"),
    "reactions": ("export/fmu/variables", "identification/from_motion", "codegen/c/names.py"),
    "regressor": ("codegen/c/metadata.py", "codegen/c/names.py", "kernel/by_name"),
    "residual": (
        *("control/feedforward_result", "control/inversion/result", "integration/system"),
        "pictures/measured/motions",
    ),
    "rollout": (
        *("adapters/jax", "export/wasm/pack", "runtime/raw", "kernel/stepping/adaptive", "sweep/driver", "sweep/keys"),
        *("codegen/c/lanes.py", "codegen/c/projects/ros2.py"),
    ),
    "settling": ("codegen/c/metadata.py",),
}


def _path(module: str) -> str:
    return module if module.endswith((".py", "/")) else f"src/eomgen/{module}.py"


ALLOWED = {(_path(module), word) for word, modules in WHERE.items() for module in modules}


def literals(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Return strings that are names of kernels, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in NAMES:
            yield node.lineno, node.value


def branches(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Return comparisons with groups of names, or with what is taken out of one, with their lines."""
    groups = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").endswith(GROUPS)
        for alias in node.names
        if (alias.asname or alias.name).isupper()
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            compared = {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
            yield from ((node.lineno, name) for name in sorted(compared & groups))


def modules() -> list[str]:
    """List modules that may not know kernels by name."""
    found = [str(path.relative_to(ROOT)) for top in ("src/eomgen", "codegen") for path in (ROOT / top).rglob("*.py")]
    return sorted(path for path in found if not path.startswith(tuple(KNOWN)))


def test_no_kernel_is_known_by_its_name_elsewhere() -> None:
    """A name is a literal in the table and in writers alone, and nothing else branches on one."""
    found = []
    for path in modules():
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        found += [f"{path}:{line}: {word!r}" for line, word in literals(tree) if (path, word) not in ALLOWED]
        found += [f"{path}:{line}: a comparison with {name}" for line, name in branches(tree)]
    assert not found, "\n".join(found)


def test_what_is_allowed_is_needed() -> None:
    """Modules and words that may have names do have some."""
    found: dict[str, set[str]] = {}
    for path in {*(path for path, _ in ALLOWED), *KNOWN} - {"codegen/kernels/"}:
        found[path] = {word for _, word in literals(ast.parse((ROOT / path).read_text(encoding="utf-8")))}
    assert all(found.values()), [path for path, words in found.items() if not words]
    assert {(path, word) for path, word in ALLOWED if word not in found[path]} == set()
    assert OTHERS.keys() == WHERE.keys()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('kernel.calls.run("mass_matrix", None, (q,))', ["mass_matrix"]),
        ('if name == "forward_dynamics_jet2": pass', ["forward_dynamics_jet2"]),
        ("kernel.mass_matrix(q)", []),
    ],
)
def test_literals_are_found(text: str, expected: list[str]) -> None:
    assert [word for _, word in literals(ast.parse(text))] == expected


def test_branches_by_groups_are_found() -> None:
    """A comparison with a group is one with names."""
    text = "from eomgen.codegen.kernels.groups import INERTIA\nif name in INERTIA: pass\nbuild(kernels=INERTIA)"
    assert list(branches(ast.parse(text))) == [(2, "INERTIA")]
