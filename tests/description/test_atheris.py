"""Coverage-guided fuzzing with atheris: no traceback, 2 s and 512 MB each."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.file_mutants import FILES, any_mutant, good
from tests.support.mutations import DOCUMENTS, XML, as_document, as_xml
from tests.support.soak import WHOLE

pytest.importorskip("atheris", reason="atheris has no wheel for this Python and machine")
ROOT = Path(__file__).parents[2]
SEEDS = 40
# A process begins with the peak memory of the one that started it, which libFuzzer would take for its own.
FRESH = (sys.executable, "-c", "import subprocess, sys; sys.exit(subprocess.run(sys.argv[1:]).returncode)")


def guided(kind: str, folder: Path, *flags: str) -> int:
    """How many inputs atheris tried, from a corpus of good files and mutants."""
    corpus = folder / "corpus"
    corpus.mkdir()
    for index, content in enumerate(good(kind) if kind in FILES else []):
        (corpus / f"good{index}").write_bytes(content)
    for index, tree in enumerate(DOCUMENTS.get(kind, [])):
        text = as_xml(tree) if kind in XML else as_document(tree)
        (corpus / f"good{index}").write_text(text, encoding="utf-8")
    for seed in range(SEEDS):
        (corpus / f"mutant{seed}").write_bytes(any_mutant(kind, 50_000_000 + seed))
    command = [
        *FRESH,
        sys.executable,
        "-m",
        "tests.support.atheris_target",
        kind,
        "-timeout=2",
        "-rss_limit_mb=512",
        "-max_len=8192",
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    found = subprocess.run(
        [*command, *flags, "-print_final_stats=1", f"-artifact_prefix={folder}/", str(corpus)],
        capture_output=True,
        env=environment,
        cwd=folder,
    )
    said = found.stderr.decode(errors="replace") + found.stdout.decode(errors="replace")
    assert found.returncode == 0, said[-6000:]
    tried = re.search(r"stat::number_of_executed_units:\s*([0-9]+)", said)
    assert tried is not None, said[-2000:]
    return int(tried.group(1))


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["toml", "urdf", "mjcf", "scenario", "plan", "tolerances", *FILES])
def test_guided_inputs(kind: str, tmp_path: Path) -> None:
    seconds = 90 if kind in ("toml", "urdf") and WHOLE else 10
    tried = guided(kind, tmp_path, "-timeout=2", f"-max_total_time={seconds}")
    print(f"\natheris, {kind}: {tried} inputs in {seconds} s")
