"""Which of three methods takes the next steps: the one that leads on furthest for its cost, and what it begins with."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from eomgen.runtime.stepping.adaptive import KEPT_NUMBERS
from eomgen.runtime.stepping.alternation import ELIMINATION, EVALUATION, FRESH, Alternation, Spent, Turn, implicit_spans
from eomgen.runtime.stepping.options import NARROW_TURNS


@pytest.mark.parametrize("best", NARROW_TURNS)
def test_the_method_that_leads_furthest_goes_on(best: str) -> None:
    """Also where it becomes the best on the way; all others are tried, and take a tenth of all work at most."""
    model = Alternation(NARROW_TURNS)
    work = dict.fromkeys(NARROW_TURNS, 0.0)
    order = [model.method]
    for k in range(4000):
        worth = 3.0 if model.method == (best if k > 400 else "tsit5") else 1.0
        cost = {"tsit5": 6.0, "rosenbrock": 15.0, "radau": 40.0}[model.method] * model.steps
        if k > 500:
            work[model.method] += cost
        model.took(Turn(model.steps, worth * cost, 0, cost))
        if model.method != order[-1]:
            order.append(model.method)
    assert set(order) == set(NARROW_TURNS)
    assert order[:3] == list(NARROW_TURNS)
    assert work[best] > 0.9 * sum(work.values())


def test_steps_that_run_up_say_nothing_of_what_a_method_is_worth() -> None:
    model = Alternation(("tsit5", "radau"))
    model.took(Turn(model.steps, 1.0, 0, 1.0))
    assert model.method == "radau"
    model.took(Turn(model.steps, 0.0, 0, 100.0))
    assert model.method == "radau"
    model.took(Turn(model.steps, 2.0, 0, 1.0))
    assert model.method == "radau"
    assert model.steps == 64


def test_a_method_begins_with_its_own_length_and_without_a_past() -> None:
    model, row = Alternation(("tsit5", "radau")), np.arange(20.0)
    progress = SimpleNamespace(next=0.001)
    model.took(Turn(model.steps, 1.0, 0, 1.0))
    model.hand_over(progress, row)
    assert progress.next == 0.001
    assert tuple(row[:4]) == FRESH
    assert row[4:KEPT_NUMBERS].tolist() == [4.0, 5.0]
    assert not row[KEPT_NUMBERS:].any()
    row[-1], progress.next = 1.0, 0.1
    model.hand_over(progress, row)
    assert (row[-1], progress.next) == (1.0, 0.1)
    for _ in range(2):
        model.took(Turn(model.steps, 0.0, 0, 1.0))
    assert model.method == "tsit5"
    model.hand_over(progress, row)
    assert (row[-1], progress.next) == (1.0, 0.001)


def test_work_of_radau_is_counted() -> None:
    progress, row = SimpleNamespace(steps=3, rejected=1, t=2.0, sample=1), np.zeros(20)
    row[4:6] = 50.0, 2.0
    before = Spent(progress, 0.0, row)
    progress.steps, progress.t = 5, 2.5
    row[4:6] = 72.0, 3.0
    assert before.until_now("radau") == Turn(2, 0.5, 22, EVALUATION * 22 + ELIMINATION)
    assert before.until_now("tsit5") == Turn(2, 0.5, 12, 12.0)
    assert implicit_spans(NARROW_TURNS, {"tsit5": 1.0, "rosenbrock": 2.0, "radau": 4.0}) == {
        "implicit_s": 6.0,
        "radau_s": 4.0,
    }
