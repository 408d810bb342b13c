"""Places of run-time parameters by their names, for derivatives by parameters."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import InputError, UnknownNameError
from ..names import nearest_or_all
from ..runtime.arrays import names_in
from ..runtime.parameters import Parameters


def parameter_slots(parameters: Parameters, names: Sequence[str]) -> list[int]:
    """Return places of parameters by their names.

    Raises:
        InputError: a text instead of a sequence of names, or a name that stands twice.
        UnknownNameError: not a run-time parameter.
    """
    names = names_in("parameters", names)
    known = {name: slot for slot, name in enumerate(parameters)}
    for name in names:
        if name not in known:
            raise UnknownNameError(f"parameters: {name!r} is unknown{nearest_or_all(str(name), known)}")
    if len(set(names)) < len(names):
        raise InputError(f"parameters: {', '.join(names)}; allowed: every name once")
    return [known[name] for name in names]
