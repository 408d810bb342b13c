"""Robot -> Kernel: stages, the cache of sources and packages, loading, costs.

Uses runtime, robot, description and codegen (joint, kernels, c, samples, package).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .stages import KERNEL_NAMES, Options, build, generate, make_source

__all__ = ["KERNEL_NAMES", "Options", "build", "generate", "make_source"]


if not TYPE_CHECKING:  # or type checkers would take every name to be there

    def __getattr__(name: str) -> Any:
        """Names of ``stages``, which whoever looks at the cache alone need not wait for."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from . import stages

        return getattr(stages, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
