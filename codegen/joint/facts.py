"""Facts about the joints of a model: those that it carries, others derived by SymPy; and names of the lemmas."""

from __future__ import annotations

from eomgen.robot.geometry import LINEAR, JointFacts
from eomgen.robot.model import Model

LEMMA_7 = "lemma (7): two translations"
SHARPER = "sharper lemma: nothing downstream turns a translation"


def lemma_of(first: str, second: str) -> str:
    """Name the lemma about a pair of coordinates whose second derivative vanishes."""
    return LEMMA_7 if first in LINEAR and second in LINEAR else SHARPER


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
