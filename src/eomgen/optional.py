"""Packages that only some functions need, and what is said where one of them is not installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .errors import InputError

EXTRAS = {  # the extra of eomgen that installs a package, by the package's name as people write it
    "SciPy": "sim",
    "Matplotlib": "sim",
    "scikit-sundae": "sim",
    "Zarr (Python 3.11 or later)": "sweep",
    "Dask": "sweep",
    "pyarrow": "sweep",
    "viser": "view",
    "CasADi": "casadi",
    "JAX": "jax",
}


@contextmanager
def optional_import(package: str, needed_by: str, otherwise: str = "") -> Iterator[None]:
    """Around imports of a package that need not be there: ``with optional_import("SciPy", "splines need"):``.

    Args:
        package: one of EXTRAS.
        needed_by: what needs it, with the verb; the message begins with it.
        otherwise: what works without it; the message ends with it.

    Raises:
        InputError: an import fails; says what needs the package, and how to install it.
    """
    try:
        yield
    except ImportError:
        advice = f'pip install "eomgen[{EXTRAS[package]}]"'
        text = "; ".join(filter(None, (f"{needed_by} {package}: {advice}", otherwise)))
        raise InputError(text) from None
