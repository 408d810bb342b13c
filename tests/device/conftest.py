"""A device of CUDA without one: a stub of its driver, and one of NVRTC."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import eomgen
from eomgen.device import driver, nvrtc
from tests.device.fakes import Stub, compiled


@pytest.fixture(scope="session")
def stub_paths(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Paths of the stubs."""
    return compiled(tmp_path_factory.mktemp("stub"))


@pytest.fixture(scope="module")
def stub(stub_paths: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stub]:
    """The stubs in the place of the libraries; what they compile is of no use to others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "LIBRARIES", (str(stub_paths[0]),))
        patch.setattr(nvrtc, "SYSTEM", (str(stub_paths[1]),))
        patch.setattr(nvrtc, "WHEELS", ())
        patch.setenv("STUB_FOLDER", str(tmp_path_factory.mktemp("images")))
        patch.setenv("STUB_VERSION", str(time.time_ns() % 2_000_000_000))
        yield Stub(*stub_paths)


@pytest.fixture(scope="module")
def kernel(built: Any) -> eomgen.Kernel:
    """The robot of a single link, with derivatives to compare with."""
    names = ("inverse_dynamics", "inverse_dynamics_adjoint", "mass_matrix", "kinematics", "frame_pose_adjoint")
    return built("one_link", *names, "rollout")  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def device(stub: Stub, kernel: eomgen.Kernel) -> Any:
    """Its methods on the first device."""
    return kernel.device("cuda")
