"""One file without SIMD, and sines of the C library: what the text says, and which bits stay."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from tests.support.c_project import need, run
from tests.support.commands import command
from tests.support.quick_builds import answer, python

FLAGS = ("-O0",)
KERNELS = ("mass_matrix", "forward_dynamics", "kinematics", "rollout")
QS = np.linspace(-3.0, 3.0, 22).reshape(11, 2)
CALLS = """
    import importlib, json, sys
    import numpy as np
    sys.path.insert(0, {folder!r})
    kernel = importlib.import_module("one_link").kernel
    q = np.array({q})
    v, u = q[::-1].copy(), np.ones_like(q)
    found = [kernel.mass_matrix(q), kernel.forward_dynamics(q, v, u), *kernel.rollout(q, v, u, 1e-3, 5)]
    found += [kernel.mass_matrix(q[2]), kernel.frame_pose(q, "tcp")]
    print(json.dumps([x.tolist() for x in found]))
"""


def numbers(package: Path) -> Any:
    """What a generated package computes in a process of its own, alone and of several states."""
    return answer(python(CALLS.format(folder=str(package.parent), q=QS.tolist())))


def preprocessed(package: Path) -> str:
    need("gcc")
    return run("gcc", "-E", "-P", package / "one_link.c")


@pytest.mark.quick
def test_one_file_without_vectors_gives_the_same_bits(tmp_path: Path) -> None:
    default = generate("one_link", tmp_path / "default", Options(KERNELS, flags=FLAGS))
    package = generate("one_link", tmp_path / "scalar", Options(KERNELS, flags=FLAGS, scalar=True), cmake=True)
    assert not (package / "one_link_batch.c").exists()
    assert "one_link_batch.c" not in (package / "CMakeLists.txt").read_text(encoding="ascii")
    assert "vector_size" in preprocessed(default)
    assert "vector_size" not in preprocessed(package)
    assert numbers(package) == numbers(default)


@pytest.mark.quick
def test_sines_of_the_c_library(tmp_path: Path) -> None:
    """The option is in the text, of both files, and the numbers are those of libm, which Python calls, too."""
    command("generate", "one_link", "-o", tmp_path, "--libm", "--kernels", "mass_matrix", "--levels", "v1")
    package = tmp_path / "one_link"
    for name in ("one_link.c", "one_link_batch.c"):
        assert "#define EOM_LIBM" in (package / name).read_text(encoding="ascii")
    assert "0.6366197723675814" not in preprocessed(package)
    q = np.linspace(-3.0, 3.0, 4000).reshape(-1, 2)
    code = f"""
        import json, sys
        import numpy as np
        sys.path.insert(0, {str(tmp_path)!r})
        import one_link
        q = np.linspace(-3.0, 3.0, 4000).reshape(-1, 2)
        found = one_link.mass_matrix(q), np.array([one_link.mass_matrix(x) for x in q])
        print(json.dumps([x[:, 0, 1].tolist() for x in found]))
    """
    several, alone = answer(python(code))
    assert several == alone == [-0.5 * math.sin(angle) for angle in q[:, 1]]
    polynomials = eomgen.build("one_link", kernels=("mass_matrix",)).mass_matrix(q)[:, 0, 1]
    assert (polynomials != several).any()
    assert np.abs(polynomials - several).max() < 1e-15
