"""The page about qualifying generated code: chains of calls, and that its table is of the code as it is."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import ModuleType

import pytest

from eomgen.pipeline.generating import package_options
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from tests.support.c_project import need
from tests.support.optional import module_of

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "qualifying.md").read_text(encoding="utf-8")
NODE = 'node: {{ title: "{0}" label: "{0}\\na.c:1:1\\n{1} bytes (static)" }}\n'
EDGE = 'edge: {{ sourcename: "{0}" targetname: "{1}" label: "a.c:2:2" }}\n'


@pytest.fixture(scope="module")
def page() -> ModuleType:
    return module_of(DOCS / "qualifying.py")


def test_the_deepest_chain_counts(page: ModuleType) -> None:
    sizes = {"top": 10, "a": 100, "b": 20, "c": 300, "loop": 7}
    calls = [("top", "a"), ("top", "b"), ("b", "c"), ("a", "sin"), ("loop", "__indirect_call"), ("loop", "a")]
    graph = "".join(NODE.format(*x) for x in sizes.items()) + "".join(EDGE.format(*x) for x in calls)
    assert page.chains(graph) == {"top": 330, "a": 100, "b": 320, "c": 300, "loop": 337}
    with pytest.raises(AssertionError, match="not known"):
        page.chains(graph + 'node: { title: "d" label: "d\\na.c:1:1\\n8 bytes (dynamic)" }\n')


@pytest.mark.parametrize("robot", ["one_link", "four_bar"])
def test_operations_of_the_table_are_those_of_the_code(robot: str, page: ModuleType) -> None:
    rows = {row[0]: row[1:] for row in re.findall(rf"\| {robot} \| `(\w+)` \| (\d+) \| (\d+) \| (\d+) \| (\d+) ", PAGE)}
    meta = json.loads(make_source(robot, package_options(robot, Options(scalar=True))).meta)
    assert len(rows) > 10
    for name, counts in rows.items():
        expected = meta["operations"][meta["functions"][name]["kernel"]]
        assert [int(x) for x in counts] == [expected[key] for key in page.COUNTED]


def test_gcc_gives_the_stack_of_every_function_of_the_table(page: ModuleType) -> None:
    """Its frames are those of its version: that they are there, and that callers have more than what they call."""
    need("gcc")
    found = page.stacks(make_source("one_link", package_options("one_link", Options(scalar=True))))
    assert set(re.findall(r"\| one_link \| `(\w+)`", PAGE)) <= found.keys()
    assert found["rollout"] > found["forward_dynamics"] > 0
