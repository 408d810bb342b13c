"""Write the generated parts of committed pages, and docs/claims.md: python docs/tables.py.

With --check: status 1 if they differ instead.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import eomgen
from eomgen import limits
from eomgen.codegen.kernels.equations import derive
from eomgen.description.load import robot_from_toml
from eomgen.pipeline.costs import robot_info
from eomgen.robot.model import build_model

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]  # for benchmarks and generators

from generators import kernels, packages, public  # noqa: E402

ROBOTS = ("one_link", "puma560", "ur5", "puma560_elastic")
DIFFERENTIATED = ("inverse_dynamics", "forward_dynamics")
MOST_SHOWN = 7  # packages of an extra that the table names
ARM_BEHIND = """
[[links]]
name = "arm{0}"
mass = 5.0
com = [0.1, 0.2, 0.0]
inertia = {{ xx = 0.5, yy = 0.4, zz = 0.3 }}
[[joints]]
name = "turn{0}"
parent = "{1}"
child = "arm{0}"
type = "revolute"
placement = {{ xyz = [0.1, 0.3, 0.2], rpy_deg = [90, 0, 0] }}
"""  # a joint that turns, and its link
CLAIMS = "docs/claims.md"
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "bias_force", "generalized_force")


def operations() -> str:
    """Table of operation counts of the built-in robots."""
    rows = ["| robot | coordinates | " + " | ".join(name.replace("_", " ") for name in KERNELS) + " |"]
    rows.append("|---" * (len(KERNELS) + 2) + "|")
    for name in ROBOTS:
        info = robot_info(eomgen.load_robot(name))
        counts = [info.operations[kernel] for kernel in KERNELS]
        cells = [f"{c['mul']}/{c['add']}" + (f" + {c['div']} div" if c["div"] else "") for c in counts]
        rows.append(f"| {name} | {info.model.size} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def derivatives() -> str:
    """Operations of kernels, of their gradients and of their second derivatives."""
    header = [f"{name}, {what}" for name in DIFFERENTIATED for what in ("once", "gradient", "second derivatives")]
    rows = ["| robot | coordinates | " + " | ".join(x.replace("_", " ") for x in header) + " |"]
    rows.append("|---" * (len(header) + 2) + "|")
    for name in ROBOTS:
        model = build_model(eomgen.load_robot(name))
        kernels = [f"{name}{ending}" for name in DIFFERENTIATED for ending in ("", "_adjoint", "_hessian")]
        counts = [derive(model, kernel).count() for kernel in kernels]
        cells = [f"{count['mul'] + count['add']}" for count in counts]
        rows.append(f"| {name} | {model.size} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def claims() -> str:
    """Return the page of claims: which command made which figure."""
    from benchmarks.claims import table_page

    return table_page()


def precision() -> str:
    """Return the ratios of times to several errors, of the last run of ``make bench``."""
    from benchmarks.precision_page import ratios
    from benchmarks.precision_report import read

    return ratios(read(ROOT / "docs" / "precision.json"))


EXTRAS = {  # for users, then for who works on the repository
    "sim": "simulations, time integration by SciPy and SUNDIALS, identification, calibration, plots",
    "view": "`eomgen view`: results in 3-D in the browser, with meshes of a URDF",
    "compiler": "a C compiler where there is none (zig); WebAssembly, live pages",
    "tables": "`to_pandas()`, `to_xarray()` of results",
    "sweep": "results of sweeps in Zarr and Parquet, clusters by Dask, streams of long simulations",
    "casadi": "functions of CasADi",
    "jax": "functions of JAX; with `cuda`, on devices",
    "torch": "functions of PyTorch; with `cuda`, on devices",
    "cuda": 'kernels on devices of NVIDIA, `kernel.device("cuda")`',
    "mujoco": "models of MuJoCo (MJCF)",
    "xacro": "descriptions that end in .xacro",
    "completion": "completion of commands in bash, zsh, fish",
    "bench": "comparison with other libraries: `make bench`",
    "docs": "these pages as a site: `make docs`",
    "wheel": "`make wheel`",
    "test": "`make test`: the quick tests",
    "lint": "`make lint`",
    "test-all": "`make test-all`, `make soak`",
    "coverage": "`make coverage`",
    "mutation": "`make mutation`",
}


def extras() -> str:
    """Return a table of the extras of pyproject.toml: what each is for, and what it installs.

    Raises:
        ValueError: an extra has no words here, or the other way round.
    """
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    groups = tomllib.loads(text)["project"]["optional-dependencies"]
    if set(groups) != set(EXTRAS):
        raise ValueError(f"extras of pyproject.toml without words, or words without extra: {set(groups) ^ set(EXTRAS)}")
    rows = ["| extra | for | installs |", "|---|---|---|"]
    for name, purpose in EXTRAS.items():
        packages = [re.split(r"[<>=; ]", package)[0] for package in groups[name]]
        shown = packages if len(packages) <= MOST_SHOWN else [*packages[: MOST_SHOWN - 1], f"{len(packages)} in all"]
        rows.append(f"| `{name}` | {purpose} | {', '.join(shown)} |")
    return "\n".join(rows)


def sizes() -> str:
    """Limits of what files may hold."""
    from eomgen.bending.finite_elements import MOST_ENTRIES, MOST_NODES
    from eomgen.bending.link_files import MOST_COUNT, MOST_UNKNOWNS
    from eomgen.motion.measured_numbers import SHORTEST
    from eomgen.npz import most_bytes
    from eomgen.runtime.levels import LEVELS

    rows = [
        ("links, joints, frames, springs ... of a description, each", f"{limits.MOST_ENTRIES}"),
        ("segments of a beam", f"{limits.MOST_SEGMENTS}"),
        ("modes of a link that bends; of a beam, in one direction", f"{limits.MOST_MODES}; {limits.MOST_BEAM_MODES}"),
        ("numbers in descriptions, scenarios and plans", f"below {limits.LARGEST:g} in size"),
        (
            "numbers in measured files and tables of tolerances",
            f"below {limits.LARGEST:g} in size; deviations and weights from {1.0 / limits.LARGEST:g} on; samples at"
            f" least {SHORTEST:g} s apart",
        ),
        (
            "arrays of a .npz file, as numbers of 8 bytes; texts of one",
            f"{most_bytes() // 1_000_000} MB, or what EOMGEN_NPZ_MB says; {limits.MOST_TEXTS}",
        ),
        ("nodes, and entries of a matrix, of a link's finite elements", f"{MOST_NODES}, {MOST_ENTRIES}"),
        (
            "sets of nodes of an input file, nodes of all of them together; matrices, coordinate systems of a file",
            f"{limits.MOST_SETS}, {limits.MOST_SET_MEMBERS}; {limits.MOST_MATRICES}, {limits.MOST_SYSTEMS}",
        ),
        (
            "interfaces of a link that bends out of a file, and numbers of their modes",
            f"{limits.MOST_INTERFACES}, {limits.MOST_SHAPE_NUMBERS}",
        ),
        (
            "rows, and modes beside those of interfaces, of finite elements that descriptions name",
            f"{MOST_UNKNOWNS}, {MOST_COUNT}",
        ),
        ("levels of processors that packages have code for, on x86-64", ", ".join(LEVELS)),
    ]
    return "\n".join(["| | at most |", "|---|---|", *(f"| {what} | {most} |" for what, most in rows)])


def sliding() -> str:
    """Multiplications of the gantry whose trolley slides along its beam, and of one with a rail at a node."""
    text = (ROOT / "src/eomgen/robots/gantry.toml").read_text(encoding="utf-8")
    rail = 'node = "middle"\ntype = "prismatic"\nplacement = { rpy_deg = [0, 90, 0] }'
    on_node = text.replace('along = "beam"\n', "").replace('type = "prismatic"\nz =', f"{rail}\nz =")
    arm = "\n".join(ARM_BEHIND.format(i, "load" if i == 0 else f"arm{i - 1}") for i in range(6))
    kernels = ("inverse_dynamics", "forward_dynamics")
    rows = ["| trolley | coordinates | inverse dynamics | forward dynamics | more |", "|---|---:|---:|---:|---:|"]
    for label, robot in (
        ("slides along the beam", text),
        ("on a rail at a node", on_node),
        ("slides, six joints more behind it", text + arm),
        ("on a rail, six joints more", on_node + arm),
    ):
        model = build_model(robot_from_toml(robot))
        inverse, forward = (derive(model, kernel).count()["mul"] for kernel in kernels)
        rows.append(f"| {label} | {model.size} | {inverse} | {forward} | {forward - inverse} |")
    return "\n".join(rows)


PARTS = {
    "docs/theory.md": {"sliding": sliding},
    "docs/adapters.md": {"differentiable": kernels.differentiable},
    "docs/comparison.md": {"operations": operations, "precision": precision},
    "docs/derivatives.md": {"derivatives": derivatives},
    "docs/start.md": {"extras": extras},
    "docs/limits.md": {"sizes": sizes},
    "docs/python.md": {"arguments": kernels.arguments, "kernels": kernels.table},
    "docs/stability.md": {"names": public.names},
    "docs/architecture.md": {
        "packages": packages.table,
        "rules": packages.rules,
    },
}


def filled(page: str) -> str:
    """The text of a page with its generated parts as they are now."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for name, make in PARTS[page].items():
        begin, end = f"<!-- begin of {name} -->\n", f"<!-- end of {name} -->"
        before, rest = text.split(begin)
        text = before + begin + make() + "\n" + end + rest.split(end, 1)[1]
    return text


def main() -> int:
    differ = False
    whole = {CLAIMS: claims()}
    for page, wanted in {**whole, **{page: filled(page) for page in PARTS}}.items():
        now = (ROOT / page).read_text(encoding="utf-8") if (ROOT / page).exists() else ""
        differ |= now != wanted
        if "--check" not in sys.argv[1:] and now != wanted:
            (ROOT / page).write_text(wanted, encoding="utf-8")
    return int(differ and "--check" in sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
