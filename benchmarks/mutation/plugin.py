"""Plugin of pytest that runs tests in a given order and notes what they say, or records what they execute."""

import json
import os
import resource
from pathlib import Path

import pytest

GIVEN = json.loads(Path(os.environ["MUTATION_RUN"]).read_text(encoding="utf-8"))  # tests, budget in s, log


def _note(**entry):
    with open(GIVEN["log"], "a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")


def _cpu():
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def pytest_collection_modifyitems(config, items):
    """Keep the tests of the list, in its order."""
    if GIVEN["tests"]:
        rank = {test: i for i, test in enumerate(GIVEN["tests"])}
        items[:] = sorted((item for item in items if item.nodeid in rank), key=lambda item: rank[item.nodeid])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item, nextitem):
    """Attribute what is executed to the test; end when the budget is spent."""
    if GIVEN["tests"]:
        _note(test=item.nodeid, outcome="started")
    else:
        import coverage

        coverage.Coverage.current().switch_context(item.nodeid)
    result = yield
    if GIVEN["budget"] and _cpu() > GIVEN["budget"]:
        item.session.shouldstop = "the budget is spent"
    return result


def pytest_runtest_logreport(report):
    """Note outcomes of calls, and of what fails before and after them."""
    if GIVEN["tests"] and (report.when == "call" or report.outcome != "passed"):
        _note(test=report.nodeid, outcome=report.outcome, what=str(report.longrepr)[-300:] if report.failed else "")


def pytest_collectreport(report):
    """Note modules that cannot be imported."""
    if GIVEN["tests"] and report.failed:
        _note(test=report.nodeid, outcome="failed", what=str(report.longrepr)[-300:])
