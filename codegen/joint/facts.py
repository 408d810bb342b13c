"""Facts about the joints of a model: those that it carries, others derived by SymPy; and names of the lemmas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from eomgen.robot.geometry import LINEAR, JointFacts
from eomgen.robot.model import Model, with_offset_angles

LEMMA_7 = "lemma (7): two translations"
SHARPER = "sharper lemma: nothing downstream turns a translation"


def lemma_of(first: str, second: str) -> str:
    """Name the lemma about a pair of coordinates whose second derivative vanishes."""
    return LEMMA_7 if first in LINEAR and second in LINEAR else SHARPER


def with_facts(model: Model, find: Callable[[tuple[str, ...]], JointFacts]) -> Model:
    """Return a model that carries the facts about the joints of all its trees.

    Args:
        model: with followers as it was described.
        find: returns the facts about joints with some active coordinates.
    """
    models = (model, model.tree, with_offset_angles(model)[0])
    kinds = {body.active for x in models for body in x.bodies}
    return replace(model, facts={active: find(active) for active in sorted(kinds)})


def facts_of(model: Model, active: tuple[str, ...]) -> JointFacts:
    """Return the facts about joints with these active coordinates: the model's, or derived once in this process.

    Raises:
        InternalError: a proof fails.
    """
    known = model.facts.get(active)
    if known is None:
        from .deriving import derive_joint  # imports SymPy

        known = derive_joint(active)
    return known
