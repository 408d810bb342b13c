"""Required figures: held, missed, not measured, and how pages say so."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from benchmarks.bars import Bar, conclusion

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.parametrize(
    ("bar", "verdict", "brackets"),
    [
        (Bar("ratio", 9.1, 10.0), "missed", "(10, missed)"),
        (Bar("ratio", 10.0, 10.0), "held", "(10)"),
        (Bar("seconds", 5.1, 5.0, at_most=True), "missed", "(5, missed)"),
        (Bar("seconds", 5.0, 5.0, at_most=True), "held", "(5)"),
        (Bar("ratio", None, 10.0), "not measured", "(10)"),
        (Bar("ratio", float("nan"), 10.0), "missed", "(10, missed)"),
        (Bar("seconds", float("nan"), 5.0, at_most=True), "missed", "(5, missed)"),
    ],
)
def test_verdicts(bar: Bar, verdict: str, brackets: str) -> None:
    assert (bar.verdict, bar.brackets) == (verdict, brackets)


def test_a_missed_bar_is_never_called_held() -> None:
    held, missed, absent = Bar("a", 2.0, 1.0), Bar("b", 18.2, 30.0), Bar("c", None, 3.0)
    assert conclusion([held]) == "All 1 required figures are held."
    assert conclusion([held, missed]) == "Required figures that are missed: b (18.2 of 30)."
    assert conclusion([held, absent]) == "Required and not measured: c."
    assert conclusion([missed, absent]).count(".") == 3


def test_nobody_else_decides() -> None:
    """No other module of benchmarks writes a verdict of its own."""
    for path in BENCHMARKS.rglob("*.py"):
        if path.name == "bars.py":
            continue
        words = {node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant)}
        assert not words & {"held", "missed", "MISSED", "not measured"}, path
