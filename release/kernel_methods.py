"""Write the methods of kernels from the table of kernels: python -m release.kernel_methods.

Signatures and descriptions of arguments come from the table.  What is described in words, the summary, the
details and the errors, stays as the module has it; for a new kernel it is the text of the table at first.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from eomgen.codegen.kernels.entries import Signature
from eomgen.codegen.kernels.signatures import CORE, MORE, OWN_KERNELS
from eomgen.runtime.bound import PARTS

PATH = Path(__file__).parents[1] / "src/eomgen/kernel/kernel_methods.py"
SHAPES = {"q": "(n,)", "v": "(n,)", "a": "(n,)", "u": "(n,)"}
TYPES = {
    "wrench": "WrenchLike | None = None",
    "z": "ArrayLike | None = None",
    "cut": "bool = False",
    "out": "Array | None = None",
}
WORDS = {
    "frame": "name of a frame or link.",
    "wrench": "external wrenches, (links, 6), or by name; see ``Kernel``.",
    "z": "internal states of force laws, (m,), where there are some.",
    "cut": "of a robot with loops: compute the open tree, whose loops are cut.",
    "out": "array to write to.",
}
Z_AFTER_ARRAYS = ("forward_dynamics", "drive_forces")  # whose z needs no name
SECTION = re.compile(r"\n\n(Args|Raises):\n")
INTRODUCTION = {
    CORE: "Methods of kernels that call a function of C each; see ``Kernel`` for arrays, batches and errors.",
    MORE: "Methods of the same kind for forces of single parts, sensors and the constraint; see ``Functions``.",
}
HEAD = '''"""Methods of kernels, written by ``python -m release.kernel_methods`` from the table of kernels.

Docstrings may be edited here: but for arguments they are kept.
"""

# mypy: disable-error-code="empty-body"

from __future__ import annotations

from numpy.typing import ArrayLike

from ..runtime.bound import WrenchLike
from ..runtime.direct import BoundFunctions
from ..runtime.raw import Array
from .declared_methods import kernel_method
'''


def public() -> Iterator[tuple[str, Signature]]:
    """Iterate over functions that have a generated method, in the order of the table."""
    for name, signature in OWN_KERNELS.items():
        for function, called in (signature.functions or {name: signature}).items():
            if called.method:
                yield function, called


def docstrings(text: str) -> Mapping[str, str]:
    """Return the docstrings of all methods in the text of a module, by their names."""
    functions = [x for x in ast.walk(ast.parse(text)) if isinstance(x, ast.FunctionDef)]
    return {function.name: ast.get_docstring(function) or "" for function in functions}


def documented(signature: Signature, found: str) -> str:
    """Return the docstring of a method: words as they were, arguments as the table has them."""
    before, *rest = SECTION.split(found or signature.text)
    sections = dict(zip(rest[::2], rest[1::2], strict=True))
    arrays = [x for x in signature.reads if x in SHAPES]
    lines = [f"    {', '.join(arrays)}: {SHAPES[arrays[0]]}."]
    framed = ("frame",) if signature.method and signature.writes in ("pose", "jacobian") else ()
    taken = [*framed, *(x for x in signature.reads if x not in SHAPES), *signature.takes, "out"]
    lines += [f"    {label}: {WORDS[label]}" for label in taken]
    parts = [before, "Args:\n" + "\n".join(lines)] if len(taken) > 1 else [before]
    if "Raises" in sections:
        parts.append("Raises:\n" + sections["Raises"])
    return "\n\n".join(parts)


def method(name: str, signature: Signature, found: str) -> str:
    """Return the text of a method."""
    framed = ["frame"] if signature.writes in ("pose", "jacobian") else []
    options = [*signature.takes, "out"]
    reads = [f"{x}: {'WrenchLike' if x == 'wrench' else 'ArrayLike'}" for x in signature.reads]
    parameters = ["self", *reads, *(f"{x}: str" for x in framed)]
    if "z" in options and name in Z_AFTER_ARRAYS:  # the last of its arguments of state
        parameters.append(f"z: {TYPES['z']}")
    parameters += ["*", *(f"{x}: {TYPES[x]}" for x in options if not any(p.startswith(f"{x}:") for p in parameters))]
    returned = "tuple[Array, ...]" if signature.writes in PARTS else "Array"
    head = f"    def {name}({', '.join(parameters)}) -> {returned}:"
    if len(head) > 120:
        head = "\n".join([f"    def {name}(", *(f"        {x}," for x in parameters), f"    ) -> {returned}:"])
    doc = documented(signature, found).replace("\n", "\n        ").replace("        \n", "\n")
    closing = "\n        " if "\n" in doc else ""
    otherwise = f'"{signature.otherwise}"' if signature.otherwise else ""
    return f'    @kernel_method({otherwise})\n{head}\n        """{doc}{closing}"""\n'


def module(text: str) -> str:
    """Return the text of the module, with the words of what it was before."""
    found, parts = docstrings(text), [HEAD]
    for kind in (CORE, MORE):
        methods = [method(name, x, found.get(name, "")) for name, x in public() if x.method == kind]
        own = ["    _bound: BoundFunctions\n"]
        parts.append(f'\nclass {kind}:\n    """{INTRODUCTION[kind]}"""\n\n' + "\n".join([*own, *methods]))
    return "\n".join(parts)


def main() -> int:
    """Write the module; with --check, return 1 where that would change it."""
    now = PATH.read_text(encoding="utf-8")
    made = module(now)
    if "--check" in sys.argv[1:]:
        return int(made != now)
    PATH.write_text(made, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
