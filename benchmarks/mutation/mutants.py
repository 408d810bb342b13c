"""Mutants of a module's text: mutmut's operators on its syntax tree, and some that fit code of vectors and traces.

Of mutmut's operators two are left out because what they make nearly always fails at once and would flatter the figure:
arguments that become None or are dropped, and assignments of None.  In their place: neighbouring arguments swapped, an
operand or a summand dropped, a call replaced by one of its arguments, a condition turned round.

Docstrings, annotations, decorators, messages of errors, assertions and notes (comments of the generated C), texts for
people (strings with a blank), and ``strict=True`` of zip are left alone.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Callable, Iterator

import libcst as cst
from libcst.metadata import ByteSpanPositionProvider, MetadataWrapper, PositionProvider
from mutmut.mutation.mutators import mutation_operators, operator_arg_removal, operator_assignment

from tests.support.mutant import Mutant

LEFT_OUT = (operator_arg_removal, operator_assignment)
SILENT = ("note", "_prove", "isinstance", "InternalError", "cast")  # calls whose arguments are messages, or no choice
COMMUTATIVE = ("add", "sum_mat", "dot", "_dot", "min", "max")  # the order of their arguments changes nothing
UNARY_CALLS = ("add", "scale", "cross", "matvec", "matmul", "transpose", "symmetric", "less", "sum_mat", "rotated")


def swap_arguments(node: cst.Call) -> Iterator[cst.CSTNode]:
    """Yield mutants f(a, b) -> f(b, a) for neighbours without a keyword, where the order of arguments counts."""
    if isinstance(node.func, cst.Name) and node.func.value in COMMUTATIVE:
        return
    for i in range(len(node.args) - 1):
        pair = node.args[i : i + 2]
        if not any(arg.keyword or arg.star for arg in pair) and not pair[0].deep_equals(pair[1]):
            a, b = (arg.value for arg in pair)
            if not a.deep_equals(b):
                swapped = (pair[0].with_changes(value=b), pair[1].with_changes(value=a))
                yield node.with_changes(args=[*node.args[:i], *swapped, *node.args[i + 2 :]])


def drop_operand(node: cst.BinaryOperation) -> Iterator[cst.CSTNode]:
    """Yield mutants a + b -> a, a + b -> b, a - b -> a, a * b -> a."""
    yield node.left
    if isinstance(node.operator, cst.Add | cst.BitAnd | cst.BitOr):
        yield node.right


def drop_call(node: cst.Call) -> Iterator[cst.CSTNode]:
    """Yield mutants matvec(R, x) -> x, add(x, y) -> x and y of functions that return the kind of an argument."""
    if isinstance(node.func, cst.Name) and node.func.value in UNARY_CALLS:
        for arg in node.args:
            if not arg.keyword and not arg.star:
                yield arg.value


def turn_condition(node: cst.If | cst.While) -> Iterator[cst.CSTNode]:
    """Yield mutants if x -> if not x."""
    inside = node.test.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])
    yield cst.UnaryOperation(cst.Not(), inside)


Operator = Callable[[cst.CSTNode], Iterator[cst.CSTNode]]
OPERATORS: list[tuple[type, Operator]] = [
    *((kind, operator) for kind, operator in mutation_operators if operator not in LEFT_OUT),
    (cst.Call, swap_arguments),
    (cst.BinaryOperation, drop_operand),
    (cst.Call, drop_call),
]


class _Collector(cst.CSTVisitor):
    METADATA_DEPENDENCIES = (ByteSpanPositionProvider, PositionProvider)

    def __init__(self, module: str, source: str) -> None:
        super().__init__()
        self.module, self.source, self.mutants = module, source, list[Mutant]()
        self.functions: list[str] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if _is_silent(node):
            return False
        if isinstance(node, cst.FunctionDef | cst.ClassDef):
            self.functions.append(node.name.value)
        if isinstance(node, cst.If | cst.While):
            for mutant in turn_condition(node):
                self._add(node.test, mutant)
        for kind, operator in OPERATORS:
            if isinstance(node, kind):
                for mutant in operator(node):
                    self._add(node, mutant)
        return True

    def on_leave(self, node: cst.CSTNode) -> None:
        if isinstance(node, cst.FunctionDef | cst.ClassDef):
            self.functions.pop()

    def _add(self, node: cst.CSTNode, mutant: cst.CSTNode) -> None:
        if isinstance(node, cst.SimpleString) and (" " in node.value or '"""' in node.value):
            return
        span = self.get_metadata(ByteSpanPositionProvider, node)
        text = cst.Module([]).code_for_node(mutant)
        if isinstance(mutant, cst.BaseExpression) and not isinstance(
            mutant, cst.Name | cst.BaseNumber | cst.BaseString
        ):
            text = f"({text})"
        line = self.get_metadata(PositionProvider, node).start.line
        where = ".".join(self.functions)
        self.mutants.append(Mutant(self.module, line, where, span.start, span.start + span.length, text))


def _is_silent(node: cst.CSTNode) -> bool:
    """Return whether a node is left as it is."""
    if isinstance(node, cst.Annotation | cst.Decorator | cst.Raise | cst.Assert | cst.Import | cst.ImportFrom):
        return True
    if isinstance(node, cst.Arg) and node.keyword is not None and node.keyword.value == "strict":
        return True
    if isinstance(node, cst.Call):
        name = node.func.attr if isinstance(node.func, cst.Attribute) else node.func
        return isinstance(name, cst.Name) and name.value in SILENT
    return isinstance(node, cst.AnnAssign) and node.value is None


def mutants_of(module: str, source: str, most: int = 0) -> tuple[list[Mutant], int]:
    """Return mutants of a module in the order of its text, and how many there are.

    At most ``most`` of them, if that is not 0.

    The choice is random with the module's name as the seed.  A text that means the same is no mutant.
    """
    collector = _Collector(module, source)
    MetadataWrapper(cst.parse_module(source)).visit(collector)
    unique = sorted({m.place(): m for m in collector.mutants}.values(), key=Mutant.place)
    order = random.Random(module).sample(unique, len(unique))
    plain, mutants = ast.dump(ast.parse(source)), list[Mutant]()
    while order and (not most or len(mutants) < most):
        mutant = order.pop()
        if _means(mutant.applied(source)) not in (plain, None):
            mutants.append(mutant)
    return sorted(mutants, key=Mutant.place), len(unique)


def _means(text: str) -> str | None:
    try:
        return ast.dump(ast.parse(text))
    except SyntaxError:
        return None
