"""Programs -> C source.  Python decides here, templates hold the C.

A program becomes a function of one statement per value; a value that one other value uses is written into it.  Large
programs are split into several functions that hand values on in an array on the stack, because compilers need more
than linear time for a long function.
"""

from __future__ import annotations

import json
import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jinja2.meta
import numpy as np

from eomgen._version import __version__
from eomgen.errors import InputError
from eomgen.model import Model

from .equations import Equations
from .ir import Program, users
from .signatures import KERNELS, SIGNATURES, shapes
from .solve import coordinate_parents, solve_operations
from .source import Source, environment
from .zeros import zero_map

CHUNK = 900  # values per function
INLINE = 72  # longest expression, in characters, that is written into another one
LITERALS = {"zero": 0.0, "half": 0.5, "one": 1.0, "two": 2.0, "six": 6.0}  # of templates
VECTORS = (16, 32, 64)  # bytes of a vector
LANE_VALUES = 8192  # values that a kernel for several states may keep on the stack: 512 KB of the longest vectors
FILL = 16  # from so many zeros on an output is cleared in a loop


@dataclass(frozen=True)
class Scalar:
    """The C type of numbers: double, or float with its literals and functions; or vectors of them.

    name: the type.
    suffix: of literals and of the functions of <math.h>.
    spread: macro that makes a vector of a number; empty where numbers are no vectors.
    """

    name: str
    suffix: str
    spread: str = ""

    def lanes(self) -> Scalar:
        """Vectors of these numbers, named as in ``batches.c.jinja``."""
        return replace(self, name="lanes", spread="ALL")

    def whole(self, text: str) -> str:
        """A number where a value of this type has to stand."""
        return f"{self.spread}({text})" if self.spread else text

    def literal(self, number: float) -> str:
        """A literal that reads back as the same number.

        Raises:
            InputError: the number is too large for a float.
        """
        if not self.suffix:
            return repr(float(number))
        if abs(number) > float(np.finfo(np.float32).max):
            raise InputError(f"dtype: float32 cannot hold {number!r}, a number of the description; use float64")
        return str(np.float32(number)) + self.suffix


@dataclass(frozen=True)
class Turn:
    """Numbers of the sines and cosines of ``vectors.jinja`` for one type, as literals of C.

    integer: of the same width.  shift: what brings a number's units into the lowest bits.  quarter: pi/2 in parts,
    products of all but the last exact.  sine, cosine: coefficients of powers of z = r^2, the lowest first, in
    sin r = r + r z (...), cos r = 1 - z (1/2 - z (...)).  sign: from bit 1 to the sign.
    """

    integer: str
    error: str
    source: str
    limit: str
    per_quarter: str
    shift: str
    quarter: tuple[str, ...]
    sine: tuple[str, ...]
    cosine: tuple[str, ...]
    sign: int

    @staticmethod
    def horner(coefficients: Sequence[str]) -> str:
        """A polynomial in z."""
        text = coefficients[-1]
        for number in reversed(coefficients[:-1]):
            text = f"{number} + z*({text})" if text != coefficients[-1] else f"{number} + z*{text}"
        return text


TURNS = {
    "float64": Turn(
        "long long",
        "2.5",
        "fdlibm (Sun Microsystems 1993)",
        "1e6",
        "0.63661977236758134308",
        "0x1.8p52",
        ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69"),
        (
            "-1.66666666666666324348e-01",
            "8.33333333332248946124e-03",
            "-1.98412698298579493134e-04",
            "2.75573137070700676789e-06",
            "-2.50507602534068634195e-08",
            "1.58969099521155010221e-10",
        ),
        (
            "4.16666666666666019037e-02",
            "-1.38888888888741095749e-03",
            "2.48015872894767294178e-05",
            "-2.75573143513906633035e-07",
            "2.08757232129817482790e-09",
            "-1.13596475577881948265e-11",
        ),
        62,
    ),
    "float32": Turn(
        "int",
        "2.5",
        "the Cephes library (S. L. Moshier)",
        "5e3f",
        "0.636619772f",
        "0x1.8p23f",
        ("0x1.92p+0f", "0x1.fb4p-12f", "0x1.444p-24f", "0x1.68c234p-39f"),
        ("-1.6666654611e-1f", "8.3321608736e-3f", "-1.9515295891e-4f"),
        ("4.166664568298827e-2f", "-1.388731625493765e-3f", "2.443315711809948e-5f"),
        30,
    ),
}
SCALARS = {"float64": Scalar("double", ""), "float32": Scalar("float", "f")}


@dataclass(frozen=True)
class Function:
    """A program as C: per chunk its statements, the size of the array that chunks share, arrays that are not read.

    ``angles`` are the expressions whose sines and cosines are taken before all else.
    """

    name: str
    arrays: tuple[str, ...]
    angles: tuple[str, ...]
    chunks: tuple[tuple[str, ...], ...]
    workspace: int
    unused: tuple[tuple[str, ...], ...]
    outputs: tuple[str, ...]

    @property
    def run(self) -> str:
        """Where the angles stand, if they stand side by side already; or nothing."""
        places = [re.fullmatch(r"(\w+)\[(\d+)\]", angle) for angle in self.angles]
        if not places or not all(places):
            return ""
        found = [(place[1], int(place[2])) for place in places if place]
        array, first = found[0]
        return f"{array} + {first}" if found == [(array, first + i) for i in range(len(found))] else ""


def render(equations: Equations, dtype: str) -> Source:
    """Equations -> Source.

    Args:
        dtype: "float64" or "float32".
    """
    model = equations.model
    meta = metadata(equations, dtype)
    context = _context(equations, dtype, meta)
    header = _fill("kernel.h.jinja", context)
    code = _tidy(_fill("kernel.c.jinja", context) + _fill("batches.c.jinja", {**context, **_lanes(equations, dtype)}))
    declarations = header.split("/* begin of declarations */")[1].split("/* end of declarations */")[0]
    statements = sum(len(program.instructions) for program in equations.programs.values())
    return Source(model.name, header, code, declarations, json.dumps(meta, indent=1) + "\n", statements)


def _context(equations: Equations, dtype: str, meta: Mapping[str, Any]) -> dict[str, Any]:
    """What the templates know."""
    model, scalar = equations.model, SCALARS[dtype]
    functions = {name: write_function(program, scalar) for name, program in equations.programs.items()}
    public = [name for name in KERNELS if name in equations.kernels]
    return {
        "name": model.name,
        "guard": f"EOMGEN_{model.name.upper()}_H",
        "version": __version__,
        "dtype": dtype,
        "real": scalar.name,
        "scalar": scalar.name,
        "bytes": np.dtype(dtype).itemsize,
        "literal_suffix": scalar.suffix,
        "suffix": "",
        "one": scalar.literal(1.0),
        "zero": scalar.literal(0.0),
        "pivot_limit": scalar.literal(1e-12 if dtype == "float64" else 1e-5),
        "coordinates": model.coordinates,
        "n": model.size,
        "bodies": [(body.name, body.joint) for body in model.bodies],
        "links": model.links,
        "frames": model.frames,
        "origins": 12 * len(model.frames),
        "axes": 12 * len(model.frames) + 3 * len(model.bodies),
        "frame_bodies": [model.body_of[_link_of(model, frame)] for frame in model.frames],
        "body_parents": [body.parent for body in model.bodies],
        "body_first": [body.first for body in model.bodies],
        "body_count": [len(body.active) for body in model.bodies],
        "is_rotation": [int(name in ("alpha", "beta", "gamma")) for body in model.bodies for name in body.active],
        "parameters": list(model.parameters),
        "hoisted": len(equations.setup.outputs),
        "kernels": public,
        "all_kernels": SIGNATURES,
        "all": str,
        "literals": {name: scalar.literal(value) for name, value in LITERALS.items()},
        "lane_count": 1,
        "turn": TURNS[dtype],
        "turns": any(i.op in ("sin", "cos") for p in equations.programs.values() for i in p.instructions),
        "padded": lambda count: f"PADDED({count})",
        "turned": lambda angles, count: f"{angles}, PADDED({count}), sine, cosine",
        "coordinate_parents": coordinate_parents(model),
        "sizes": {key: int(np.prod(shape)) for key, shape in shapes(model).items()},
        "functions": functions,
        "solving": any("pivot" in function.outputs for function in functions.values()),
        "batched": batched(equations),
        "looped": [name for name in public if name not in batched(equations)],
        "setup": write_function(equations.setup, scalar, turning=False),
        "loops": sorted(equations.loops),
        "survivors": christoffel_bits(model) if "christoffel" in equations.loops else [],
        "operations": meta["operations"],
    }


def _lanes(equations: Equations, dtype: str) -> dict[str, Any]:
    """What is different in the templates where a number is a vector of states."""
    scalar, lanes = SCALARS[dtype], SCALARS[dtype].lanes()
    wanted = {program for name in batched(equations) for program in SIGNATURES[name].calls or (name,)}
    functions = {name: write_function(p, lanes) for name, p in equations.programs.items() if name in wanted}
    return {
        "real": lanes.name,
        "suffix": "_lanes",
        "lane_count": "LANES",
        "padded": str,
        "turned": lambda angles, count: (
            f"(const {scalar.name} *)({angles}), {count} * LANES, ({scalar.name} *)sine, ({scalar.name} *)cosine"
        ),
        "all": lanes.whole,
        "one": lanes.whole(scalar.literal(1.0)),
        "zero_lanes": scalar.literal(0.0),
        "zero": lanes.whole(scalar.literal(0.0)),
        "functions": functions,
        "solving": any("pivot" in function.outputs for function in functions.values()),
        "lane_counts": [width // np.dtype(dtype).itemsize for width in VECTORS],
        "distances": lambda count: [1 << bit for bit in range(count.bit_length() - 1)],
        "pairs": lambda count, d: [(i, i + d) for i in range(count) if not i & d],
        "lower": lambda count, d: [count + lane - d if lane & d else lane for lane in range(count)],
        "upper": lambda count, d: [count + lane if lane & d else lane + d for lane in range(count)],
    }


def batched(equations: Equations) -> list[str]:
    """Public kernels that work on several states at a time: those whose arrays fit the stack as vectors."""
    size = {key: int(np.prod(shape)) for key, shape in shapes(equations.model).items()}

    def values(name: str) -> int:
        signature = SIGNATURES[name]
        arrays = sum(size[array] for array in (*signature.reads, signature.writes))
        if name in equations.programs:
            program = equations.programs[name]
            apart = turned(program)
            return arrays + 3 * len(apart) + len(handed_on(program, split(program, apart)))
        return arrays + max(values(program) for program in signature.calls)

    public = [name for name in KERNELS if name in equations.kernels]
    return [name for name in public if _is_vector(equations, name) and values(name) <= LANE_VALUES]


def _is_vector(equations: Equations, name: str) -> bool:
    """Whether there is C of the kernel for vectors: a program, or a template that calls programs."""
    return name in equations.programs or bool(SIGNATURES[name].calls)


def _tidy(code: str) -> str:
    """The code without the empty lines that macros leave behind."""
    code = re.sub(r"\n{3,}", "\n\n", code)
    return re.sub(r"(?<=\n{\n)\n", "", code.replace("\n\n}", "\n}"))


def _fill(template: str, context: Mapping[str, Any]) -> str:
    """The template with its context; a name that the context does not have is a bug."""
    loader = environment().loader
    assert loader is not None
    source = loader.get_source(environment(), template)[0]
    missing = jinja2.meta.find_undeclared_variables(environment().parse(source)) - set(context)
    assert not missing, f"{template} asks for {sorted(missing)}"
    return environment().get_template(template).render(context)


def christoffel_bits(model: Model) -> list[str]:
    """The zero map of the tensor C as 64-bit words, the first entry in the lowest bit."""
    mask = zero_map(model).christoffel.mask.ravel()
    padded = np.zeros(-(-mask.size // 64) * 64, bool)
    padded[: mask.size] = mask
    words = np.packbits(padded, bitorder="little").view("<u8")
    return [f"{word:#x}ULL" for word in words]


def _link_of(model: Model, frame: str) -> str:
    return {f.name: f.link for f in model.robot.frames}.get(frame, frame)


def metadata(equations: Equations, dtype: str) -> dict[str, Any]:
    """What the Python face of a kernel knows of it."""
    model = equations.model
    return {
        "generator": f"eomgen {__version__}",
        "name": model.name,
        "dtype": dtype,
        "coordinates": model.coordinates,
        "joints": [body.joint for body in model.bodies],
        "links": model.links,
        "frames": model.frames,
        "principal": model.principal,
        "parameters": dict(model.parameters),
        "hoisted": len(equations.setup.outputs),
        "shapes": {key: list(shape) for key, shape in shapes(model).items()},
        "kernels": {
            name: {"reads": KERNELS[name].reads, "writes": KERNELS[name].writes}
            for name in KERNELS
            if name in equations.kernels
        },
        "operations": operations(equations),
    }


def operations(equations: Equations) -> dict[str, dict[str, int]]:
    """Multiplications, additions, divisions and sine-cosine pairs of every kernel's C, and of the parameters' setup."""
    counts = {name: equations.programs[name].count() for name in equations.programs}
    if "christoffel" in equations.loops:
        counts["christoffel"] = {key: equations.model.size * n for key, n in counts["coriolis_matrix"].items()}
    if "forward_dynamics_jacobian" in equations.loops:
        parts = (counts["forward_dynamics"], counts["residual_jacobian"], solve_operations(equations.model))
        counts["forward_dynamics_jacobian"] = {key: sum(part[key] for part in parts) for key in parts[0]}
    if "rollout" in equations.loops:
        counts["rollout"] = counts["implicit_step"]  # of one linearly implicit step
    public = {name: counts[name] for name in KERNELS if name in counts and name in equations.kernels}
    return {**public, "parameters": equations.setup.count()}


def write_function(program: Program, scalar: Scalar, *, turning: bool = True) -> Function:
    """Program -> statements of C.

    Args:
        turning: take all sines and cosines at once in front (``turn`` of ``vectors.jinja``), not one by one.
    """
    signature = SIGNATURES.get(program.name)
    arrays: tuple[str, ...] = tuple(a for a in ("h", "p", "q", "v", "a", "u", "wrench") if a in program.inputs())
    if signature is not None:
        arrays = ("h", *signature.reads)
    writer = _Writer(program, scalar, turning)
    chunks = writer.chunks()
    unused = [[a for a in arrays if not _reads(chunk, a)] for chunk in chunks]
    if len(chunks) == 1:
        unused[0] = [a for a in unused[0] if not _reads(writer.angles, a)]
    outputs = tuple(dict.fromkeys(key[0] for key in program.outputs))
    return Function(
        program.name,
        arrays,
        tuple(writer.angles),
        tuple(tuple(chunk) for chunk in chunks),
        len(writer.slots),
        tuple(tuple(names) for names in unused),
        outputs,
    )


def _reads(chunk: Sequence[str], array: str) -> bool:
    """Whether any of the statements reads the array."""
    return any(re.search(rf"\b{array}\[", line) for line in chunk)


def turned(program: Program) -> set[int]:
    """Sines and cosines, and what they alone need: values that are no statements of their own."""
    needs = [0] * len(program.instructions)  # statements and outputs that need a value
    for index in program.outputs.values():
        needs[index] += 1
    found: set[int] = set()
    for index in range(len(program.instructions) - 1, -1, -1):
        instruction = program.instructions[index]
        if instruction.op in ("sin", "cos") or (needs[index] == 0 and instruction.args):
            found.add(index)
        else:
            for arg in instruction.args:
                needs[arg] += 1
    return found


def split(program: Program, apart: Container[int]) -> dict[int, int]:
    """For every value that is computed, the function that computes it; but for those that are ``apart``."""
    size = len(program.instructions)
    computed = [i for i in range(size) if program.instructions[i].op not in ("const", "input") and i not in apart]
    return {index: order // CHUNK for order, index in enumerate(computed)}


def handed_on(program: Program, chunk_of: Mapping[int, int]) -> dict[int, int]:
    """Values that a later function reads, and their places in the array that functions share."""
    slots: dict[int, int] = {}
    for index, chunk in chunk_of.items():
        for arg in program.instructions[index].args:
            if chunk_of.get(arg, chunk) != chunk:
                slots.setdefault(arg, len(slots))
    return slots


class _Writer:
    """Writes the statements of one program."""

    def __init__(self, program: Program, scalar: Scalar, turning: bool) -> None:
        self.program, self.scalar = program, scalar
        self.count = users(program)
        self.stores: dict[int, list[str]] = {}
        for (array, position), index in program.outputs.items():
            self.stores.setdefault(index, []).append(f"{array}[{position}]")
        apart = turned(program) if turning else set()
        self.angles: list[str] = []
        self.turns: dict[int, str] = {}  # sines and cosines that are taken in front
        self._take_turns(apart)
        self.chunk_of = split(program, apart)
        self.last = max(self.chunk_of.values(), default=0)
        self.slots = handed_on(program, self.chunk_of)

    def _take_turns(self, apart: Container[int]) -> None:
        place: dict[int, int] = {}
        for index, instruction in enumerate(self.program.instructions):
            if index in apart and instruction.op in ("sin", "cos"):
                (arg,) = instruction.args
                if arg not in place:
                    place[arg] = len(self.angles)
                    self.angles.append(self._from_inputs(arg))
                self.turns[index] = f"{'sine' if instruction.op == 'sin' else 'cosine'}[{place[arg]}]"

    def _from_inputs(self, index: int) -> str:
        """A value as one expression of inputs."""
        instruction = self.program.instructions[index]
        if not instruction.args:
            return self._leaf(index)
        return self._expression(instruction.op, [self._from_inputs(arg) for arg in instruction.args])

    def chunks(self) -> list[list[str]]:
        """Statements per chunk."""
        lines: list[list[str]] = [[] for _ in range(self.last + 1)]
        lines[0].extend(self._constant_outputs())
        text: dict[int, str] = {}
        note = ""
        known: list[dict[int, str]] = [{} for _ in lines]
        for index, instruction in enumerate(self.program.instructions):
            chunk = self.chunk_of.get(index)
            note = self.program.notes.get(index, note)
            if chunk is None:
                if index in self.turns or not instruction.args:
                    text[index] = self._leaf(index)
                continue
            args = [self._argument(arg, chunk, text, known[chunk], lines[chunk]) for arg in instruction.args]
            expression = self._expression(instruction.op, args)
            if self._is_inlined(index, expression):
                text[index] = expression
                continue
            if note:  # the last one counts: the steps before it wrote nothing
                lines[chunk].append(f"/* {note} */")
                note = ""
            if index in self.stores and self.count[index] == len(self.stores[index]):
                lines[chunk].append(f"{' = '.join(self.stores[index])} = {expression};")
                continue
            lines[chunk].append(f"const {self.scalar.name} t{index} = {expression};")
            text[index] = f"t{index}"
            if index in self.slots:
                lines[chunk].append(f"w[{self.slots[index]}] = t{index};")
            if index in self.stores:
                lines[chunk].append(f"{' = '.join(self.stores[index])} = t{index};")
        return lines

    def _constant_outputs(self) -> Iterator[str]:
        """Outputs that are numbers or inputs, zeros in a loop where there are many."""
        zeros: dict[str, int] = {}
        for index, places in self.stores.items():
            if index not in self.chunk_of and self._leaf(index) == self.scalar.literal(0.0):
                for place in places:
                    array = place.split("[")[0]
                    zeros[array] = zeros.get(array, 0) + 1
        filled = {array for array, number in zeros.items() if number >= FILL}
        for array in sorted(filled):
            size = 1 + max(position for name, position in self.program.outputs if name == array)
            yield f"for (size_t i = 0; i < {size}; ++i) {array}[i] = {self.scalar.whole(self.scalar.literal(0.0))};"
        for index, places in self.stores.items():
            if index not in self.chunk_of:
                leaf = self._leaf(index)
                kept = [p for p in places if leaf != self.scalar.literal(0.0) or p.split("[")[0] not in filled]
                if kept:
                    is_vector = self.program.instructions[index].op != "const" and not leaf.startswith(("h[", "p["))
                    yield f"{' = '.join(kept)} = {leaf if is_vector else self.scalar.whole(leaf)};"

    def _leaf(self, index: int) -> str:
        instruction = self.program.instructions[index]
        if index in self.turns:
            return self.turns[index]
        if instruction.op == "const":
            return self.scalar.literal(instruction.leaf)
        return f"{instruction.leaf[0]}[{instruction.leaf[1]}]"

    def _argument(self, arg: int, chunk: int, text: dict[int, str], known: dict[int, str], lines: list[str]) -> str:
        """The text of an argument; one from an earlier chunk is loaded once."""
        if arg not in self.chunk_of or self.chunk_of[arg] == chunk:
            return text[arg]
        if arg not in known:
            lines.append(f"const {self.scalar.name} t{arg} = w[{self.slots[arg]}];")
            known[arg] = f"t{arg}"
        return known[arg]

    def _is_inlined(self, index: int, expression: str) -> bool:
        return (
            self.count[index] == 1
            and index not in self.stores
            and index not in self.slots
            and len(expression) <= INLINE
            and self.program.instructions[index].op not in ("sin", "cos")
        )

    def _expression(self, op: str, args: Sequence[str]) -> str:
        if op in ("sin", "cos"):
            return f"{op}{self.scalar.suffix}({args[0]})"
        if op == "neg":
            return f"-{_factor(args[0])}"
        x, y = args
        if op == "add":
            return f"{x} + {_term(y)}"
        if op == "sub":
            return f"{x} - {_term(y)}"
        sign = "*" if op == "mul" else "/"
        return f"{_factor(x, leading=True)}{sign}{_factor(y)}"


def _is_sum(text: str) -> bool:
    return " " in _outside_brackets(text)


def _is_product(text: str) -> bool:
    outside = _outside_brackets(text)
    return "*" in outside or "/" in outside


def _outside_brackets(text: str) -> str:
    depth, kept = 0, []
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            kept.append(letter)
    return "".join(kept)


def _term(text: str) -> str:
    """A right summand, in brackets where its own sum or sign would be read otherwise."""
    return f"({text})" if _is_sum(text) or text.startswith("-") else text


def _factor(text: str, *, leading: bool = False) -> str:
    """A factor; a product on the right keeps its brackets, because rounding depends on the order."""
    if _is_sum(text) or (not leading and (text.startswith("-") or _is_product(text))):
        return f"({text})"
    return text
