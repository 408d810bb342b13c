"""Packages that only some functions need, and what is said where one of them is not installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .errors import InputError

PACKAGES = {  # name as people write it: what pip installs it by, and the extra of eomgen that brings it
    "SciPy": ("scipy", "sim"),
    "Matplotlib": ("matplotlib", "sim"),
    "scikit-sundae": ("scikit-sundae", "sim"),
    "clarabel": ("clarabel", "sim"),
    "Zarr": ("zarr", "sweep"),
    "Dask": ("dask[distributed]", "sweep"),
    "pyarrow": ("pyarrow", "sweep"),
    "pandas": ("pandas", "tables"),
    "xarray": ("xarray", "tables"),
    "shtab": ("shtab", "completion"),
    "viser": ("viser", "view"),
    "trimesh": ("trimesh", "view"),
    "MuJoCo": ("mujoco", "mujoco"),
    "xacro": ("xacro", "xacro"),
    "CasADi": ("casadi", "casadi"),
    "JAX": ("jax", "jax"),
    "torch": ("torch", "torch"),
}


class NotInstalledError(InputError):
    """A package that need not be there is asked for, and cannot be imported."""


@contextmanager
def optional_import(package: str, needed_by: str, otherwise: str = "") -> Iterator[None]:
    """Around imports of a package that need not be there: ``with optional_import("SciPy", "splines need"):``.

    Args:
        package: one of PACKAGES.
        needed_by: what needs it, with the verb; the message begins with it.
        otherwise: what works without it; the message ends with it.

    Raises:
        NotInstalledError: an import fails; says what needs the package, whether it is missing or broken, and how to
            install it.
    """
    try:
        yield
    except ImportError as error:
        missing = isinstance(error, ModuleNotFoundError)
        state = "which is not installed" if missing else f"which cannot be imported ({error})"
        name, extra = PACKAGES[package]
        advice = f'pip install {_quoted(name)}, or pip install "eomgen[{extra}]"'
        text = "; ".join(filter(None, (f"{needed_by} {package}, {state}: {advice}", otherwise)))
        raise NotInstalledError(text) from None


def _quoted(name: str) -> str:
    """Quote a name so that a shell takes it for one word, brackets and all."""
    return f'"{name}"' if "[" in name else name
