"""Notebooks of the examples: run, and written as pages with what they print and draw.

python docs/generators/notebooks.py FOLDER    # runs all of them, and writes copies with their outputs there
"""

from __future__ import annotations

import base64
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOKS = EXAMPLES / "notebooks"
CELL_LIMIT = 600  # s; all of a notebook takes less than a minute
LAST_LINES = 12  # of what a cell said before it failed
SCRIPTED = "import sys; del sys.ps1"  # as in a script: what takes long does not tell how far it has come
IMAGES = {"image/svg+xml": "svg", "image/png": "png"}
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")


class NotebookError(Exception):
    """A cell that failed: its notebook, its number and what it said."""


def names() -> list[str]:
    """Names of all notebooks, without ending."""
    return sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb"))


def read(name: str) -> Any:
    """The notebook as it is in the repository: nbformat's mapping, without outputs."""
    import nbformat

    return nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)


def run(name: str) -> Any:
    """The notebook with its outputs, from a kernel of its own and in a folder that is gone afterwards.

    Files of ``examples`` are in the folder above it, as in the repository.

    Raises:
        NotebookError: a cell failed.
    """
    return run_cells(read(name), name)


def run_cells(notebook: Any, name: str) -> Any:
    """The same of any notebook; ``name`` is that in errors."""
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

    with tempfile.TemporaryDirectory(prefix="eomgen-notebook-") as base:
        folder = Path(base) / "examples" / "notebooks"
        folder.mkdir(parents=True)
        for path in EXAMPLES.iterdir():
            if path.is_file():
                shutil.copyfile(path, folder.parent / path.name)
        own = {"JUPYTER_RUNTIME_DIR": f"{base}/runtime", "IPYTHONDIR": f"{base}/ipython"}
        client = NotebookClient(
            notebook,
            timeout=CELL_LIMIT,
            kernel_name="python3",
            resources={"metadata": {"path": str(folder)}},
            extra_arguments=["--IPKernelApp.log_level=ERROR", f"--IPKernelApp.exec_lines={SCRIPTED}"],
        )
        with _environment({**own, "MPLBACKEND": "module://matplotlib_inline.backend_inline"}):
            try:
                client.execute()
            except (CellExecutionError, CellTimeoutError, DeadKernelError) as error:
                raise NotebookError(f"{name}.ipynb, {_failed(notebook)}:\n{_said(error)}") from None
    return notebook


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """The process's environment with these values; kernels inherit it."""
    before = {key: os.environ.get(key) for key in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value


def _failed(notebook: Any) -> str:
    """The number and the first line of the cell that failed, or was the last to begin."""
    begun = [(k, cell) for k, cell in enumerate(notebook.cells, 1) if cell.cell_type == "code" and cell.outputs]
    wrong = [(k, cell) for k, cell in begun if any(output.output_type == "error" for output in cell.outputs)]
    for k, cell in (wrong or begun)[-1:]:
        return f"cell {k} ({cell.source.splitlines()[0]})"
    return "before any cell said anything"


def _said(error: Exception) -> str:
    lines = _COLOURS.sub("", str(error)).strip().splitlines()
    return "\n".join(lines[-LAST_LINES:])


def pages(wanted: Sequence[str] | None, say: Callable[[str, str], None]) -> dict[str, str | bytes]:
    """Pages, their figures, the notebooks themselves and the files that they read, by their paths in the site.

    Args:
        wanted: names of notebooks to run, the others are shown without outputs; all where it is None.
        say: called with a format and the name of each before it is run.
    """
    found: dict[str, str | bytes] = {}
    for name in names():
        if wanted is None or name in wanted:
            say("running the notebook %s", name)
            notebook = run(name)
        else:
            notebook = read(name)
        found |= page(name, notebook)
        found[f"notebooks/{name}.ipynb"] = (NOTEBOOKS / f"{name}.ipynb").read_bytes()
        for read_by_it in re.findall(r"\]\(\.\./([\w.]+)\)", str(notebook.cells[0].source)):
            found[read_by_it] = (EXAMPLES / read_by_it).read_bytes()
    return found


def page(name: str, notebook: Any) -> dict[str, str | bytes]:
    """A notebook as Markdown, with its figures, by their paths in the site."""
    found: dict[str, str | bytes] = {}
    parts: list[str] = []
    for k, cell in enumerate(notebook.cells, 1):
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        printed = ""
        for output in (*cell.outputs, None):
            if output is not None and output.output_type == "stream":
                printed += output.text  # a cell prints in pieces
                continue
            if printed.strip():
                parts.append(_fenced(printed))
            printed = ""
            if output is not None:
                parts += _shown(output, f"notebooks/{name}_{k}", found)
    first, _, rest = parts[0].partition("\n")
    where = f"*This page is the notebook [{name}.ipynb]({name}.ipynb), run when the page was made.*"
    found[f"notebooks/{name}.md"] = "\n\n".join([first, where, rest.strip(), *parts[1:]]) + "\n"
    return found


def _shown(output: Any, place: str, found: dict[str, str | bytes]) -> list[str]:
    """A result or a figure as Markdown; figures are added to what was found, under names that begin with a place."""
    data = output.data
    for kind, ending in IMAGES.items():
        if kind in data:
            path = f"{place}.{ending}"
            while path in found:
                path = f"{path.removesuffix(f'.{ending}')}b.{ending}"
            text = data[kind]
            found[path] = base64.b64decode(text) if ending == "png" else text
            width = output.metadata.get(kind, {}).get("width")
            return [f"![figure]({Path(path).name}){f'{{ width={width} }}' if width else ''}"]
    if "text/html" in data:
        return [data["text/html"].strip()]
    return [_fenced(data["text/plain"])]


def _fenced(text: str) -> str:
    lines = [line.rstrip() for line in _COLOURS.sub("", text).strip("\n").splitlines()]
    return "```text\n" + "\n".join(lines) + "\n```"


def main(folder: Path) -> None:
    """Run all notebooks, and write copies with outputs."""
    import nbformat

    folder.mkdir(parents=True, exist_ok=True)
    for name in names():
        nbformat.write(run(name), folder / f"{name}.ipynb")
        print(folder / f"{name}.ipynb")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
