"""Models with what SymPy derives of their joints, which the cache holds per set of active coordinates."""

from __future__ import annotations

import hashlib
import json
from importlib.metadata import version
from pathlib import Path

from .._version import __version__
from ..codegen.joint.facts import with_facts
from ..lazily import kept
from ..robot.geometry import JointFacts
from ..robot.model import Model, build_model
from ..robot.value import Robot
from . import cache as store
from .generator_key import generator_hash

_FACTS = "facts.json"  # file of an entry


@kept
def derived_model(robot: Robot) -> Model:
    """Return the robot's model with the facts about all of its joints, derived or from the cache.

    Raises:
        DescriptionError: see ``build_model``.
        BuildError: the cache cannot be written.
        InternalError: a proof fails.
    """
    return with_facts(build_model(robot), _facts)


def _facts(active: tuple[str, ...]) -> JointFacts:
    """Return the facts about joints with these active coordinates, derived or from the cache."""
    parts = [active, version("sympy"), __version__, generator_hash()]

    def make(folder: Path) -> None:
        from ..codegen.joint.deriving import derive_joint

        (folder / _FACTS).write_text(derive_joint(active).to_json(), encoding="ascii")

    found = store.entry("derivations", hashlib.sha256(json.dumps(parts).encode()).hexdigest(), make)
    return JointFacts.from_json(found.files[_FACTS])
