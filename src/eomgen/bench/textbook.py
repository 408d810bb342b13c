"""The textbook algorithms that kernels are measured against: C over a table of links, and its operation counts.

    stage               input    output
    newton_euler        Model    C            templates/bench/newton_euler.c.jinja with the description's numbers
    instrument          C        C            the same text, counting its operations as it runs
    compile_yardstick   Model    Yardstick    both, and the stopwatch, loaded

Nothing here needs SymPy.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pycparser import c_ast, c_generator, c_parser

from .._version import __version__
from ..arrays import Array
from ..names import component_name
from ..robot.elements import JOINT_ELEMENTS, KINDS
from ..robot.geometry import IDENTITY, ZERO
from ..robot.model import Model
from ..robot.value import COORDINATES
from .clock import DECLARATIONS, Stopwatch

if TYPE_CHECKING:
    from ..codegen.tree.bound import Bound

_DECLARATIONS = """
extern long operations[4];
void operations_clear(void);
"""


@dataclass(frozen=True)
class Counterpart:
    """A textbook's algorithm that does what a kernel does.

    title: what it is called.
    reads: how many arrays it reads, which are the kernel's.
    solves: whether it inverts the mass matrix, so that its round-off grows with the matrix's condition number.
    prescribes: whether it can do with coordinates whose motion is prescribed.
    """

    title: str
    reads: int
    solves: bool = False
    prescribes: bool = True


COUNTERPARTS: Mapping[str, Counterpart] = {
    "inverse_dynamics": Counterpart("recursive Newton-Euler", 3),
    "mass_matrix": Counterpart("composite bodies", 1),
    "forward_dynamics": Counterpart("articulated bodies", 3, solves=True, prescribes=False),
}


def newton_euler(model: Model) -> str:
    """Return C source of the textbook algorithms of a model that they know, the description's numbers in its tables."""
    from ..codegen.c.source import environment
    from ..codegen.tree.bound import bind

    bound = bind(model, lambda _, number: number, _sincos)
    links: list[dict[str, str]] = []
    for body, numbers in zip(model.bodies, bound.bodies, strict=True):
        for index, coordinate in zip(body.indices, body.active, strict=True):
            first, last = index == body.first, index == body.indices[-1]
            parent = index if not first else _last_link(model, body.parent)
            links.append(_link(coordinate, parent, numbers if first else None, numbers if last else None))
            links[-1]["offset"] = repr(float(bound.angle_offsets[index]))
            links[-1]["name"] = model.coordinates[index]
            law = bound.laws[index]
            links[-1]["forces"] = _numbers((law.stiffness, law.damping, bound.armature[index]))
    force_terms = ["l->stiffness * q"] if any(law.stiffness for law in bound.laws) else []
    force_terms += ["l->damping * v"] if any(law.damping for law in bound.laws) else []
    return (
        environment()
        .get_template("bench/newton_euler.c.jinja")
        .render(
            name=model.name,
            version=__version__,
            gravity=_numbers(bound.gravity),
            links=links,
            own_force=" + ".join(force_terms),
            armatures=any(bound.armature),
            offsets=any(bound.angle_offsets),
        )
    )


def unknown_to_textbook(model: Model) -> str:
    """Say what of a model the textbook's algorithms do not know; "" where they know all of it."""
    from ..codegen.tree.bound import bind

    bound = bind(model, lambda _, number: number, _sincos)
    said = [f"{what} ({', '.join(names)})" for what, names in _unknown(model, bound) if names]
    return f"the textbook's algorithms know {', '.join(said)}: kernels are timed alone" if said else ""


def _unknown(model: Model, bound: Bound) -> Iterator[tuple[str, list[str]]]:
    """Say what the textbook's algorithms know in place of something, and which parts of a robot are that."""
    cuts = [component_name(owner, name) if name else owner for owner, name, _ in model.cut_laws]
    yield "no links that bend", [model.coordinates[i] for body in model.bodies for i in body.modes]
    yield "no forces between links of a loop", cuts
    yield "no motors behind transmissions", [model.coordinates[i] for i in bound.transmissions]
    bent = [model.coordinates[i] for i, law in enumerate(bound.laws) if law.numbers]
    yield "linear springs and dampers only", bent
    for table, kind in JOINT_ELEMENTS.items():
        yield kind.BEYOND, [joint.name for joint in model.robot.joints if table in joint.elements]
    for table, elements in bound.elements.items():
        yield f"no {KINDS[table].SHORT}", [element.name for element in elements]


def _sincos(angle: float) -> tuple[float, float]:
    return float(np.sin(angle)), float(np.cos(angle))


def _last_link(model: Model, body: int) -> int:
    """Return the link, counted from 1, that moves with a body; 0 is the base."""
    return 0 if body < 0 else model.bodies[body].indices[-1] + 1


def _link(coordinate: str, parent: int, placed: Any, body: Any) -> dict[str, str]:
    """Return the table's entry of a coordinate.

    With its joint's placement if it is the first, the inertia if the last.
    """
    from ..codegen.tree.spatial import Pose

    pose = Pose(IDENTITY, ZERO) if placed is None else placed.placement
    axis = COORDINATES.index(coordinate) % 3
    has_placement = pose != Pose(IDENTITY, ZERO)
    indices = (
        parent,
        int(COORDINATES.index(coordinate) >= 3),
        axis,
        (axis + 1) % 3,
        (axis + 2) % 3,
        int(has_placement),
        int(body is not None),
    )
    mass, first, inertia = 0.0, ZERO, (0.0,) * 9
    if body is not None:
        mass, first = body.inertia.mass, body.inertia.first
        J = np.array(body.inertia.second, dtype=np.float64)
        inertia = tuple((np.trace(J) * np.eye(3) - J).ravel())
    return {
        "indices": ", ".join(map(str, indices)),
        "rotation": _numbers(x for row in pose.rotation for x in row),
        "origin": _numbers(pose.origin),
        "mass": repr(float(mass)),
        "first": _numbers(first),
        "inertia": _numbers(inertia),
    }


def _numbers(values: Any) -> str:
    return ", ".join(repr(float(x)) for x in values)


@dataclass(frozen=True)
class Yardstick:
    """The compiled textbook algorithms: ``lib`` and ``counting`` hold the same functions, the latter count.

    is_known: whether they know the robot; else there is the stopwatch alone.
    """

    ffi: Any
    lib: Any
    counting: Any
    is_known: bool = True

    def run(self, name: str, arrays: Sequence[Array], out: Array, *, counted: bool = False) -> int:
        """Call an algorithm of COUNTERPARTS for one state; 0, or 1 + the coordinate that has no inertia."""
        function = getattr(self.counting if counted else self.lib, f"newton_euler_{name}")
        pointers = [self.ffi.from_buffer("double[]", array) for array in arrays]
        return int(function(self.ffi.NULL, *pointers, self.ffi.from_buffer("double[]", out)))

    def address(self, name: str) -> int:
        """Return the address of an algorithm's code."""
        return int(self.ffi.cast("intptr_t", self.ffi.addressof(self.lib, f"newton_euler_{name}")))

    @property
    def stopwatch(self) -> Stopwatch:
        return Stopwatch(self.ffi, self.lib)

    def operations(self, name: str, arrays: Sequence[Array], out: Array) -> dict[str, int]:
        """Return operations of one call: no branch depends on the state, so that any state does."""
        self.counting.operations_clear()
        self.run(name, arrays, out, counted=True)
        return {key: int(self.counting.operations[i]) for i, key in enumerate(("mul", "add", "div", "sincos"))}


def compile_yardstick(model: Model, flags: Sequence[str], *, is_known: bool = True) -> Yardstick:
    """Compile the textbook algorithms and the stopwatch, with these flags, and load them.

    Args:
        model: the tree.
        flags: of the compiler.
        is_known: whether the algorithms know all of the model; else the stopwatch is compiled alone.

    Raises:
        BuildError: no compiler, or one that fails.
    """
    import cffi

    from ..codegen.c.source import environment
    from ..codegen.package.compile import WARNINGS, find_compiler, shared_flags
    from ..codegen.package.running import run_all

    ffi = cffi.FFI()
    ffi.cdef(DECLARATIONS + _DECLARATIONS)
    for name, counterpart in COUNTERPARTS.items():
        ffi.cdef(f"int newton_euler_{name}(const double *h{', const double *' * counterpart.reads}, double *out);")
    code = newton_euler(model) if is_known else ""
    stopwatch = environment().get_template("bench/stopwatch.c.jinja").render()
    with tempfile.TemporaryDirectory(prefix="eomgen-bench-") as private:
        folder = Path(private)
        counted = instrument(code) if is_known else ""
        for file, text in (("textbook", code), ("stopwatch", stopwatch), ("counting", counted)):
            (folder / f"{file}.c").write_text(text, encoding="ascii")
        command = (*find_compiler().command, "-fPIC", *shared_flags(), *WARNINGS)
        timed, counting = folder / "textbook.so", folder / "counting.so"
        sources = [str(folder / "textbook.c")] * is_known + [str(folder / "stopwatch.c")]
        compiled = [[*command, *flags, *sources, "-o", str(timed), "-lm"]]
        if is_known:
            compiled.append([*command, "-w", "-O1", str(folder / "counting.c"), "-o", str(counting), "-lm"])
        run_all(compiled)
        loaded = ffi.dlopen(str(timed))
        return Yardstick(ffi, loaded, ffi.dlopen(str(counting)) if is_known else loaded, is_known)


_COUNTERS = """#include <math.h>
long operations[4];
void operations_clear(void) { for (int i = 0; i < 4; ++i) operations[i] = 0; }
static double counted_mul(double x, double y) { ++operations[0]; return x * y; }
static double counted_add(double x, double y) { ++operations[1]; return x + y; }
static double counted_sub(double x, double y) { ++operations[1]; return x - y; }
static double counted_neg(double x) { ++operations[1]; return -x; }
static double counted_div(double x, double y) { ++operations[2]; return x / y; }
static double counted_sin(double x) { ++operations[3]; return sin(x); }
"""
_COUNTED = {"*": "mul", "+": "add", "-": "sub", "/": "div"}


_TYPED_BY = {"ArrayRef": "name", "StructRef": "field", "FuncCall": "name", "UnaryOp": "expr", "TernaryOp": "iftrue"}


def instrument(code: str) -> str:
    """Make every operation on doubles of some C a call that counts it; a sine stands for its cosine too."""
    plain = re.sub(r"/\*.*?\*/|^#.*?$", "", code, flags=re.DOTALL | re.MULTILINE)
    tree = c_parser.CParser().parse("double sin(double x); double cos(double x);" + plain)
    declarations = _Declarations()
    declarations.visit(tree)
    return _COUNTERS + str(c_generator.CGenerator().visit(_counted(tree, declarations.kinds)))


class _Declarations(c_ast.NodeVisitor):  # type: ignore[misc]
    """int or double for every name that is declared as one; no name may be both, in whatever scope."""

    def __init__(self) -> None:
        self.kinds: dict[str, str] = {}

    def visit_TypeDecl(self, node: Any) -> None:
        kind = getattr(node.type, "names", [""])[0]
        if node.declname and kind in ("int", "double"):
            assert self.kinds.setdefault(node.declname, kind) == kind, f"{node.declname} is int and double"
        self.generic_visit(node)

    def visit_Enumerator(self, node: Any) -> None:
        self.kinds[node.name] = "int"


def _is_double(node: Any, kinds: Mapping[str, str]) -> bool:
    """Return whether an expression of arithmetic is a double."""
    if isinstance(node, c_ast.Constant):
        return bool(node.type == "double")
    if isinstance(node, c_ast.ID):
        return kinds[node.name] == "double"
    if isinstance(node, c_ast.BinaryOp):
        return node.op in _COUNTED and (_is_double(node.left, kinds) or _is_double(node.right, kinds))
    return _is_double(getattr(node, _TYPED_BY[type(node).__name__]), kinds)


def _counted(node: Any, kinds: Mapping[str, str]) -> Any:
    """Return the node with its operations replaced, the outermost first, because types are read off the original."""

    def call(operation: str, *arguments: Any) -> Any:
        return c_ast.FuncCall(c_ast.ID(f"counted_{operation}"), c_ast.ExprList(list(arguments)))

    if isinstance(node, c_ast.BinaryOp) and _is_double(node, kinds):
        node = call(_COUNTED[node.op], node.left, node.right)
    elif isinstance(node, c_ast.Assignment) and node.op != "=" and _is_double(node.lvalue, kinds):
        node = c_ast.Assignment("=", node.lvalue, call(_COUNTED[node.op[0]], node.lvalue, node.rvalue))
    elif isinstance(node, c_ast.UnaryOp) and node.op == "-" and not isinstance(node.expr, c_ast.Constant):
        node = call("neg", node.expr) if _is_double(node.expr, kinds) else node
    elif isinstance(node, c_ast.FuncCall) and node.name.name == "sin":
        node = call("sin", *node.args.exprs)
    for name in set(node.__slots__) - {"coord", "__weakref__"}:
        child = getattr(node, name)
        if isinstance(child, list):
            setattr(node, name, [_counted(item, kinds) if isinstance(item, c_ast.Node) else item for item in child])
        elif isinstance(child, c_ast.Node):
            setattr(node, name, _counted(child, kinds))
    return node
