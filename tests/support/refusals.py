"""Calls that must raise an error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


def refused(error: type[Exception], match: str, call: Callable[..., Any], /, *arguments: Any, **options: Any) -> Any:
    """Assert that a call raises an error of this class whose message matches, and return the error."""
    with pytest.raises(error, match=match or None) as caught:
        call(*arguments, **options)
    return caught.value
