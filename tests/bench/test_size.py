"""Sizes of code: counted as by wc, of a commit as of the working tree; budgets, and lines that only become denser."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from benchmarks import size
from benchmarks.claims import ABSENT
from benchmarks.size import BUDGETS, PYTHON, Size, Sizes, contents, is_denser, measure, total

FILES = {
    "src/eomgen/base.py": b"x = 1\n\n\ndef f(a):\n    return a + x\n",
    "src/eomgen/cli/entry.py": b"import os  # " + b"-" * 120 + b"\n",
    "src/eomgen/clib/eom.h": b"int f(void);\nint g(void);\n",
    "templates/kernel/a.c.jinja": b"{{ x }}\n",
    "templates/live/three/three.js": b"vendored\n" * 7,
    "docs/page.md": b"# Four words, no more\n",
    "docs/hooks.py": b"x = 1\n",
    "README.md": b"words\n",
}


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository whose only commit is the baseline."""
    for name, data in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(data)
    (tmp_path / "src" / "eomgen" / "templates").symlink_to(tmp_path / "templates")
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "First."]):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@example.org", *words], cwd=tmp_path, check=True)
    for name, value in {"ROOT": tmp_path, "PAGE": tmp_path / "docs" / "size.md", "BASELINE": "HEAD"}.items():
        monkeypatch.setattr(size, name, value)
    return tmp_path


def test_sizes_are_those_of_wc(repository: Path) -> None:
    sizes = measure(repository)
    assert set(sizes) == set(FILES) - {"templates/live/three/three.js", "docs/hooks.py", "README.md"}
    for name, found in sizes.items():
        counted = subprocess.run(
            ["wc", "-lwc", name], cwd=repository, check=True, capture_output=True, text=True
        ).stdout
        assert [found.lines, found.words, found.bytes] == [int(x) for x in counted.split()[:3]]
    assert [name for name, found in sizes.items() if found.long] == ["src/eomgen/cli/entry.py"]
    both = [sizes[f"src/eomgen/{name}"] for name in ("base.py", "cli/entry.py")]
    assert total(sizes, ["src/eomgen"], PYTHON) == Size(*(sum(x) for x in zip(*both, strict=True)))


def test_nodes() -> None:
    """Module, Assign, Name, Store, Constant; UnaryOp and USub. A comment has no node."""
    texts = {b"x = 1\n": 5, b"x = 1  # one\n": 5, b"x = -1\n": 7}
    assert {text: size.size_of("a.py", text).nodes for text in texts} == texts
    assert size.size_of("a.c", b"x = 1;\n").nodes == 0


def test_a_commit_is_measured_without_a_checkout(repository: Path) -> None:
    before = measure(repository)
    (repository / "src/eomgen/base.py").write_bytes(b"y = 2\n")
    (repository / "src/eomgen/new.py").write_bytes(b"z = 3\n")
    assert measure(repository, "HEAD") == before
    after = measure(repository)
    assert after["src/eomgen/base.py"].lines == 1
    assert set(after) == set(before)
    assert dict(contents(repository, untracked=True))["src/eomgen/new.py"] == b"z = 3\n"


def test_denser_lines_are_no_less_code() -> None:
    before = Size(lines=100, bytes=1000, nodes=500)
    assert not is_denser(before, Size(lines=80, bytes=820, nodes=410))
    assert is_denser(before, Size(lines=80, bytes=830, nodes=400))
    assert is_denser(before, Size(lines=80, bytes=800, nodes=420))
    assert not is_denser(before, Size(lines=101, bytes=1100, nodes=600))
    assert not is_denser(Size(lines=100, bytes=1000), Size(lines=50, bytes=500))


def test_every_budget_counts_files_of_the_repository() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=size.ROOT, capture_output=True, text=True, check=False).stdout
    if not listed:
        pytest.skip("not a git repository")
    sizes: Sizes = dict.fromkeys(listed.split("\n"), Size(1))
    assert all(total(sizes, budget.folders, budget.kinds).files for budget in BUDGETS)


def test_commands(repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert size.main([]) == 0
    assert re.search(r"^\| src/eomgen/cli \| 1 \| 134 \| 3 \| 0 \| 0 \| 1 \|$", capsys.readouterr().out, re.MULTILINE)
    (repository / "src/eomgen/base.py").write_bytes(b"f = lambda a: a + g(x, y, z)\n")
    assert size.main(["--budgets"]) == 0
    printed = capsys.readouterr().out
    assert "| Python in src/eomgen | lines | 6 | 2 | 78,000 | 87,000 | 66.7 |" in printed
    assert "of the share of lines: Python in src/eomgen." in printed
    assert size.main(["--page"]) == 0
    page = size.PAGE.read_text(encoding="ascii")
    assert "| Python in src/eomgen | lines | 6 | 6 | 78,000 | 87,000 | 0.0 |" in page  # of the commit
    assert "of the share of lines: nowhere." in page
    assert size.main(["0000000"]) == 1
    assert capsys.readouterr().err.startswith(ABSENT)


@pytest.mark.soak
def test_the_page_is_that_of_its_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = size.PAGE.read_text(encoding="ascii")
    commit = re.search(r"with commit (\w+)", written)
    assert commit is not None
    monkeypatch.setattr(size, "PAGE", tmp_path / "size.md")
    if size.main(["--page", commit[1]]):
        pytest.skip("the commits of the page are not here")
    assert size.PAGE.read_text(encoding="ascii") == written
