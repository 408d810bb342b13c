"""Compiled objects of the C library are asked what is known of them, before they enter the cache.

They integrate a robot whose equations are written here: coordinates on springs and dampers that push each other.
Single steps are those of the methods in NumPy's arithmetic, to the bit where products are not fused with sums; a motion
under a signal goes where short steps in NumPy go.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cffi
import numpy as np
from numpy.typing import NDArray

from ...errors import BuildError

if TYPE_CHECKING:
    from ...codegen.package.compile import Compiler

Array = NDArray[Any]

N = 3  # coordinates: states (q, v) do not fill their blocks
STIFFNESS, DAMPING, COUPLING = (4.5, 90.3, 0.7), (0.3, 1.7, 0.11), 0.6
KP, KD, TARGET = (5.0, 0.0, 2.3), (0.7, 0.0, 1.1), (0.3, 0.0, -0.2)
STEP, STEPS = 0.06, 3
STATES: tuple[tuple[float, tuple[float, ...], tuple[float, ...]], ...] = (  # size, and q and v of what is scaled by it
    (1.0, (0.41, -0.77, 0.93), (0.37, 1.31, -0.59)),
    (2.0**-30, (-0.83, 0.29, 0.51), (0.67, -0.43, 0.91)),
    (0.0, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
)
DENORMAL = {"float64": 2.0**-1040, "float32": 2.0**-140}
FUNCTIONS: Mapping[str, tuple[str, ...]] = {
    "fixed": ("integrate_fixed", "integrate_fixed_one_by_one"),
    "adaptive": ("integrate_adaptive", "integrate_adaptive_one_by_one"),
    "fixed_lanes": ("integrate_fixed_batch",),
    "adaptive_lanes": ("integrate_adaptive_batch",),
}
ALIGNED = 64  # bytes, of vectors
ROOM = 4096  # numbers, for each lane
# A signal of one column that acts on the middle coordinate: a polynomial until half a second, constant from then on.
KNOTS, PIECES, DRIVEN, SAMPLES = (0.0, 0.5, 2.0), ((0.4, -3.0, 11.0, 7.0), (-9.0, 0.0, 0.0, 0.0)), 1, 8
WITHIN = {"float64": (1e-9, 2e-7), "float32": (1e-4, 6e-3)}  # tolerance of the motion, and its error


def check_library(compiler: Compiler, flags: tuple[str, ...], dtype: str, component: str, folder: Path) -> None:
    """Let a fresh component of the library, in a folder, integrate known motions.

    Raises:
        BuildError: it does not load, or computes something else than it should; the compiler's command is named.
    """
    from ...codegen.package.compile import fuses
    from ...codegen.package.library import library_command
    from ...codegen.package.probe import refusal
    from ...codegen.package.running import in_new_thread

    opened = _open(compiler, flags, folder, component, dtype)

    def work() -> str | None:
        with np.errstate(all="ignore"):
            examination = _Examination(*opened(), dtype, bits=not fuses(flags))
            asked = {
                "fixed": examination.of_fixed,
                "adaptive": examination.of_adaptive,
                "fixed_lanes": examination.of_fixed_lanes,
                "adaptive_lanes": examination.of_adaptive_lanes,
            }
            return next(asked[component](), None)

    wrong = in_new_thread(work)
    if wrong is not None:
        reason = f"the compiled C library computes something else than its methods: {wrong}"
        raise BuildError(refusal(reason, library_command(compiler, flags, dtype, component, folder)))


def _open(
    compiler: Compiler, flags: tuple[str, ...], folder: Path, component: str, dtype: str
) -> Callable[[], tuple[Any, dict[str, Any]]]:
    """Link a component into a shared library; return a function that opens it: cffi's object and functions by name."""
    from ...codegen.c.library import FOLDER, library_functions
    from ...codegen.package.compile import link_shared
    from ...codegen.package.library import HIDDEN, OBJECT, library_flags, precision_flags
    from ...codegen.package.running import run_all

    prefix, names = "eomf" if dtype == "float32" else "eom", FUNCTIONS[component]
    macros = [f"EOM{'_WIDE' * component.endswith('_lanes')}({name})" for name in names]
    table = f"void (*eom_checked[{len(macros)}])(void)"  # the functions themselves are hidden
    code, made, library = (folder / f"checked.{ending}" for ending in ("c", "o", "so"))
    declared = "".join(f"void {name}(void);\n" for name in macros)
    filled = f"extern {table};\n{table} = {{ {', '.join(macros)} }};\n"
    width = "extern int eom_checked_lanes;\nint eom_checked_lanes = LANES;\n"
    code.write_text(f'#include "{FOLDER}/lanes.h"\n{declared}{filled}{width}', encoding="ascii")
    chosen = [flag for flag in (*library_flags(flags), *precision_flags(dtype)) if flag != HIDDEN]
    run_all([[*compiler.command, "-c", "-fPIC", *chosen, "-O0", str(code), "-o", str(made)]])
    link_shared(compiler, [made, folder / OBJECT], library)
    ffi, text = cffi.FFI(), library_functions(dtype)
    ffi.cdef(f"{text}\nextern {table};\nextern int eom_checked_lanes;")

    def opened() -> tuple[Any, dict[str, Any]]:
        try:
            lib: Any = ffi.dlopen(str(library))
        except OSError as error:
            raise BuildError(f"the compiled C library does not load: {error}") from None
        functions = {}
        for place, name in enumerate(names):
            result, arguments = re.findall(rf"^(.*) {prefix}_{name}\((.*)\);$", text, re.MULTILINE)[0]
            functions[name] = ffi.cast(f"{result} (*)({arguments})", lib.eom_checked[place])
        functions["library"] = lib  # which is open as long as this is kept
        functions["lanes"] = int(lib.eom_checked_lanes) if component.endswith("_lanes") else 0
        for path in (code, made, library):
            path.unlink()
        return ffi, functions

    return opened


class _Equations:
    """Equations of the robot on arrays (n, lanes): q'' = u - k q - d q' + c q_next q'_before."""

    def __init__(self, dtype: str, *, controlled: bool = False) -> None:
        self.dtype = np.dtype(dtype)
        self.k, self.d, self.kp, self.kd, self.target = (
            np.array(x, self.dtype)[:, np.newaxis] for x in (STIFFNESS, DAMPING, KP, KD, TARGET)
        )
        self.c, self.controlled = self.dtype.type(COUPLING), controlled

    def run(self, name: str, **inputs: Array) -> tuple[Array, Array]:
        """Return the answer of a program of these equations, with drives that a controller adds to, and no status."""
        if self.controlled:
            inputs = self._driven(name, dict(inputs))
        answer: Array = getattr(self, name)(**inputs)
        return answer, np.zeros(answer.shape[1], np.int64)

    def _driven(self, name: str, inputs: dict[str, Any]) -> dict[str, Any]:
        if name == "stage_factors":
            inputs |= {"kp": self.kp + inputs["kp"], "kd": self.kd + inputs["kd"]}
        if "u" in inputs:
            q, v, ahead = inputs["q"], inputs["v"], inputs["dt"][0] if name == "implicit_step" else self.dtype.type(0.0)
            left = self.target - q - ahead * v if name == "implicit_step" else self.target - q
            inputs["u"] = inputs["u"] + (self.kp * left - self.kd * v)
            if name == "implicit_step":
                inputs["added"] = ahead * (self.kd + ahead * self.kp)
        return inputs

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        """Return accelerations."""
        acceleration: Array = u - self.k * q - self.d * v + self.c * np.roll(q, -1, 0) * np.roll(v, 1, 0)
        return acceleration

    def implicit_step(self, q: Array, v: Array, u: Array, added: Array, dt: Array) -> Array:
        """Return accelerations with springs and dampers at the end of a step."""
        right = self.forward_dynamics(q, v, u) - dt[0] * self.k * v
        return np.asarray(right / (self.dtype.type(1.0) + dt[0] * self.d + dt[1] * self.k + added))

    def stage_factors(self, q: Array, v: Array, kp: Array, kd: Array, times: Array) -> Array:
        """Return the matrix of a stage, its stiffness, and its time."""
        stiffness = self.k + kp + 0.0 * q
        matrix = self.dtype.type(1.0) + times[0] * (self.d + kd) + times[1] * stiffness
        return np.concatenate([matrix, stiffness, times[:1] + 0.0 * q[:1]])

    def stage_solution(self, q: Array, kept: Array, rates: Array, shifts: Array) -> Array:
        """Return the difference of a stage's solution from its right side."""
        matrix, stiffness, time = kept[:N], kept[N : 2 * N], kept[2 * N]
        return np.asarray((rates - time * stiffness * shifts) / matrix - rates)


class _Examination:
    """Asks a component of the library; errors are told in words."""

    def __init__(self, ffi: Any, functions: Mapping[str, Any], dtype: str, *, bits: bool) -> None:
        self.ffi, self.functions, self.bits = ffi, functions, bits
        self.dtype, self.prefix = np.dtype(dtype), "eomf" if dtype == "float32" else "eom"
        self.real = "float" if dtype == "float32" else "double"
        self.equations, self.lanes = _Equations(dtype), functions["lanes"] or 1
        self.suffix = "_lanes" if functions["lanes"] else ""
        self._kept: list[Any] = []  # what C points to
        self.robot = self._robot()
        self.work = self._new(f"{self.prefix}_workspace{self.suffix} *", self._rooms())[0]
        self.states = [
            tuple(np.array(x, self.dtype) * self.dtype.type(size or DENORMAL[dtype]) for x in (q, v, q[::-1]))
            for size, q, v in STATES
        ]

    def _new(self, kind: str, value: Any = None) -> Any:
        self._kept.append(self.ffi.new(kind) if value is None else self.ffi.new(kind, value))
        return self._kept[-1]

    def _pointer(self, array: Array | None) -> Any:
        if array is None:
            return self.ffi.NULL
        self._kept.append(array)
        return self.ffi.from_buffer(f"{'double' if array.dtype == np.float64 else 'float'}[]", array)

    def _rooms(self) -> list[Any]:
        """Return a workspace as callers have it: filled with anything, vectors where they may lie."""
        bytes_of = {"scalar": self.dtype.itemsize, "double": 8, "int": 4}
        filled = {kind: np.ones(size * ROOM * self.lanes + ALIGNED, np.uint8) for kind, size in bytes_of.items()}
        rooms = [array[-array.ctypes.data % ALIGNED :] for array in filled.values()]
        kinds = (self.real, "double", "int")
        self._kept += rooms
        return [self.ffi.cast(f"{kind} *", self.ffi.from_buffer(room)) for kind, room in zip(kinds, rooms, strict=True)]

    def _robot(self) -> Any:
        """Return the robot as the library knows it: its equations are called back."""
        fields = {name: field.type for name, field in self.ffi.typeof(f"{self.prefix}_robot{self.suffix}").fields}
        sizes = self._new(f"{self.prefix}_sizes *", {"n": N, "hoisted": 1, "factors": 2 * N + 1, "wrench": 6})

        def array(pointer: Any, size: int) -> Array:
            data = self.ffi.buffer(pointer, size * self.lanes * self.dtype.itemsize)
            return np.frombuffer(data, self.dtype).reshape(size, self.lanes)

        def called(name: str, reads: Mapping[str, int], size: int) -> Any:
            def work(h: Any, *pointers: Any) -> int:
                arguments = {key: array(x, reads[key]) for key, x in zip(reads, pointers, strict=False) if key != "h"}
                with np.errstate(all="ignore"):
                    array(pointers[-1], size)[:] = self.equations.run(name, **arguments)[0]
                return 0

            self._kept.append(self.ffi.callback(fields[name], work))
            return self._kept[-1]

        def solution(h: Any, kept: Any, rates: Any, shifts: Any, out: Any) -> int:
            arguments = (array(kept, 2 * N + 1), array(rates, N), array(shifts, N))
            with np.errstate(all="ignore"):
                array(out, N)[:] = self.equations.stage_solution(arguments[1], *arguments)
            return 0

        self._kept.append(self.ffi.callback(fields["stage_solution"], solution))
        table = {
            "sizes": sizes,
            "stage_solution": self._kept[-1],
            "forward_dynamics": called("forward_dynamics", {"q": N, "v": N, "u": N}, N),
            "implicit_step": called("implicit_step", {"q": N, "v": N, "u": N, "added": N, "dt": 2}, N),
            "stage_factors": called("stage_factors", {"q": N, "v": N, "kp": N, "kd": N, "times": 2}, 2 * N + 1),
        }
        return self._new(f"{self.prefix}_robot{self.suffix} *", table)

    def _drive(self, u: Array, *, controlled: bool, effort: Array | None = None) -> Any:
        gains = {}
        if controlled:
            controller = {"kp": KP, "kd": KD, "target": TARGET}
            gains = {name: self._pointer(np.array(x, self.dtype)) for name, x in controller.items()}
        fields = {
            "u": self._pointer(u),
            "u_state": N if len(u) > 1 and u.ndim > 1 else 0,
            "effort": self._pointer(effort),
        }
        return self._new(f"{self.prefix}_drive *", {**fields, **gains})

    def _cases(self) -> Iterator[tuple[int, int, bool, tuple[Array, Array, Array], Array | None]]:
        """Yield methods, numbers of states, whether there is a controller, states with drives, and their limits."""
        for number, state in enumerate(self.states):
            for method in (0, 1):
                yield method, number, False, state, None
                yield method, number, True, state, None
                yield method, number, False, state, np.abs(state[2]) * self.dtype.type(0.75)

    def of_fixed(self) -> Iterator[str]:
        """Tell what is wrong with a few steps of fixed length, alone and in a loop over states."""
        from ...codegen.samples.steps import clipped, one_step

        dt, h = self.dtype.type(STEP), self._pointer(np.zeros(1, self.dtype))
        for method, number, controlled, (q, v, u), effort in self._cases():
            drive = self._drive(u, controlled=controlled, effort=effort)
            equations = _Equations(str(self.dtype), controlled=controlled)
            moved = q[:, np.newaxis], v[:, np.newaxis]
            held = (u if effort is None else clipped(u, effort))[:, np.newaxis]
            rows = [np.concatenate([x.ravel() for x in moved])]
            for _ in range(STEPS):
                moved = one_step(method, equations.run, *moved, held, dt)[0]  # type: ignore[assignment]
                rows.append(np.concatenate([x.ravel() for x in moved]))
            outs = [np.zeros((2, STEPS + 1, N), self.dtype) for _ in range(2)]
            how, at = (dt, STEPS, 1, method), [self._pointer(x) for x in (q, v)]
            for name, out in zip(FUNCTIONS["fixed"], outs, strict=True):
                alone = (self.robot, h, *at, drive, self.ffi.NULL, 0.0)
                begin = alone if name == "integrate_fixed" else (self.robot, 1, h, at[0], N, at[1], N, drive)
                code = self.functions[name](*begin, *how, *map(self._pointer, out), self.work)
                if code != -1:
                    yield f"{name} of method {method} fails with {code}"
                yield from self._compared(f"{name} of method {method}", number, np.concatenate(out, axis=1), rows)

    def of_fixed_lanes(self) -> Iterator[str]:
        """Tell what is wrong with a few steps of fixed length of many states."""
        from ...codegen.samples.steps import clipped, one_step

        dt, h = self.dtype.type(STEP), self._pointer(np.zeros(1, self.dtype))
        for method, controlled, (q, v, u), effort in self._many_cases():
            drive = self._drive(u, controlled=controlled, effort=effort)
            equations = _Equations(str(self.dtype), controlled=controlled)
            held = u.T if effort is None else clipped(u.T, effort[:, np.newaxis])
            moved, rows = (q.T, v.T), [np.concatenate([q, v], axis=1)]
            for _ in range(STEPS):
                moved = one_step(method, equations.run, *moved, held, dt)[0]  # type: ignore[assignment]
                rows.append(np.concatenate([x.T for x in moved], axis=1))
            out = np.zeros((2, len(q), STEPS + 1, N), self.dtype)
            begin = (self.robot, len(q), h, self._pointer(q), N, self._pointer(v), N, drive)
            how = (dt, STEPS, 1, method, *map(self._pointer, out), self.work)
            code = self.functions["integrate_fixed_batch"](*begin, *how)
            if code != -1:
                yield f"steps of many states by method {method} fail with {code}"
            wanted = np.stack(rows, axis=1)
            for k, answer in enumerate(np.concatenate(out, axis=2)):
                yield from self._compared(f"a batch by method {method}", k % len(STATES), answer, list(wanted[k]))

    def of_adaptive_lanes(self) -> Iterator[str]:
        """Tell what is wrong with steps with error control of many states: single ones, and motions."""
        from ...codegen.samples.steps import clipped, one_adapted_step

        dt, atol = self.dtype.type(STEP), np.full(2 * N, np.finfo(self.dtype).max, self.dtype)
        for method, controlled, (q, v, u), effort in self._many_cases():
            drive = self._drive(u, controlled=controlled, effort=effort)
            equations = _Equations(str(self.dtype), controlled=controlled)
            held = u.T if effort is None else clipped(u.T, effort[:, np.newaxis])
            end = one_adapted_step(method, equations.run, q.T, v.T, held, dt)[0]
            wanted = np.concatenate([x.T for x in end], axis=1)
            out, steps = self._adapted_many(method, drive, (q, v), np.array([0.0, STEP]), (0.0, atol, [STEP] * len(q)))
            if set(steps) != {1}:
                yield f"a batch by method {method} takes {steps} steps for 1"
            for k, answer in enumerate(out):
                rows = [np.concatenate([q[k], v[k]]), wanted[k]]
                yield from self._compared(f"a batch by method {method}", k % len(STATES), answer, rows)
        rtol, near = WITHIN[str(self.dtype)]
        times, inputs, wanted = self._motion()
        count = 2 * self.lanes + 1
        state = tuple(np.tile(x, (count, 1)) for x in self.states[0][:2])
        first = [0.5 / (1.0 + k) for k in range(count)]  # so that lanes have different steps
        drive, atol = self._drive(np.zeros((1, N), self.dtype), controlled=False), np.full(2 * N, rtol, self.dtype)
        for method in (0, 1):
            out, _ = self._adapted_many(method, drive, (state[0], state[1]), times, (rtol, atol, first), inputs)
            error = np.abs(out - wanted)
            if not (error <= near).all():
                yield f"motions of many states by method {method} are {np.max(error):.3g} off"

    def _many_cases(self) -> Iterator[tuple[int, bool, tuple[Array, Array, Array], Array | None]]:
        """Yield methods, whether there is a controller, states with drives (count, n), and greatest sizes of drives."""
        count = 2 * self.lanes + 1
        q, v, u = (np.array([self.states[k % len(STATES)][i] for k in range(count)]) for i in range(3))
        for method in (0, 1):
            yield method, False, (q, v, u), None
            yield method, True, (q, v, u), None
            yield method, False, (q, v, u), np.abs(u[0]) * self.dtype.type(0.75)

    def _adapted_many(
        self,
        method: int,
        drive: Any,
        state: tuple[Array, Array],
        times: Array,
        how: tuple[float, Array, list[float]],
        inputs: Any = None,
    ) -> tuple[Array, list[int]]:
        """Return states (count, samples + 1, 2 n) at times, and numbers of steps; ``how`` with first steps."""
        rtol, atol, first = how
        count, (q, v) = len(first), (x.copy() for x in state)
        out, h = np.zeros((2, count, len(times), N), self.dtype), self._pointer(np.zeros(1, self.dtype))
        allowed = self._new(f"{self.prefix}_tolerance *", {"rtol": rtol, "atol": self._pointer(atol), "most": 100000})
        progress = self._new("eom_progress[]", [{"next": x} for x in first])
        acting = self.ffi.NULL if inputs is None else inputs
        begin = (self.robot, count, self.ffi.NULL, h, 0, drive, acting, 0, allowed, 0, self._pointer(times))
        last = (len(times) - 1, method, *map(self._pointer, (q, v, *out)), progress, self.work)
        self.functions["integrate_adaptive_batch"](*begin, *last)
        return np.concatenate(out, axis=2), [int(x.steps) for x in progress]

    def of_adaptive(self) -> Iterator[str]:
        """Tell what is wrong with steps with error control: single ones, and a motion with many."""
        from ...codegen.samples.steps import clipped, one_adapted_step

        dt = self.dtype.type(STEP)
        atol = np.full(2 * N, np.finfo(self.dtype).max, self.dtype)
        for method, number, controlled, (q, v, u), effort in self._cases():
            if effort is not None and controlled:
                continue
            drive = self._drive(u, controlled=controlled, effort=effort)
            equations = _Equations(str(self.dtype), controlled=controlled)
            held = (u if effort is None else clipped(u, effort))[:, np.newaxis]
            end = one_adapted_step(method, equations.run, q[:, np.newaxis], v[:, np.newaxis], held, dt)[0]
            rows = [np.concatenate([q, v]), end.ravel()]
            for name in FUNCTIONS["adaptive"]:
                out, steps = self._adapted(name, method, drive, (q, v), np.array([0.0, STEP]), (0.0, atol, STEP))
                if steps != 1:
                    yield f"{name} of method {method} takes {steps} steps for 1"
                yield from self._compared(f"{name} of method {method}", number, out, rows)
        yield from self._of_motion()

    def _adapted(
        self,
        name: str,
        method: int,
        drive: Any,
        state: tuple[Array, Array],
        times: Array,
        how: tuple[float, Array, float],
        inputs: Any = None,
    ) -> tuple[Array, int]:
        """Return states (samples + 1, 2 n) at times, and the number of steps; ``how``: tolerances and a first step."""
        rtol, atol, first = how
        q, v = (x.copy() for x in state)
        out, h = np.zeros((2, len(times), N), self.dtype), self._pointer(np.zeros(1, self.dtype))
        allowed = self._new(f"{self.prefix}_tolerance *", {"rtol": rtol, "atol": self._pointer(atol), "most": 100000})
        progress, acting = self._new("eom_progress *", {"next": first}), self.ffi.NULL if inputs is None else inputs
        last = (self._pointer(times), len(times) - 1, method, *map(self._pointer, (q, v, *out)), progress)
        if name == "integrate_adaptive":
            self.functions[name](self.robot, h, drive, acting, allowed, *last, self.ffi.NULL, self.work)
        else:
            begin = (self.robot, 1, self.ffi.NULL, h, 0, drive, acting, 0, allowed, 0)
            self.functions[name](*begin, *last, self.work)
        return np.concatenate(out, axis=1), int(progress.steps)

    def _of_motion(self) -> Iterator[str]:
        """Yield errors of a motion under a signal that jumps, after too long a first step, with samples in steps."""
        rtol, near = WITHIN[str(self.dtype)]
        q, v, _ = self.states[0]
        times, inputs, wanted = self._motion()
        drive, atol = self._drive(np.zeros(N, self.dtype), controlled=False), np.full(2 * N, rtol, self.dtype)
        for method in (0, 1):
            answer, _ = self._adapted("integrate_adaptive", method, drive, (q, v), times, (rtol, atol, 0.5), inputs)
            error = np.abs(answer - wanted)
            if not (error <= near).all():
                yield f"a motion by method {method} is {np.max(error):.3g} off"

    def _motion(self) -> tuple[Array, Any, Array]:
        """Return times, the signal as inputs, and the motion (samples + 1, 2 n) from the first state on under it."""
        q, v, _ = self.states[0]
        times = np.linspace(0.0, 1.0, SAMPLES + 1)
        knot, coefficient, stop = np.array(KNOTS), np.array(PIECES), np.array(KNOTS[1:2])
        spline = {"knot": self._pointer(knot), "coefficient": self._pointer(coefficient.ravel())}
        signal = self._new("eom_spline *", {**spline, "pieces": 2, "degree": 3, "columns": 1})
        torque = self._new("eom_track *", {"signal": signal, "place": self._new("int[1]", [DRIVEN])})
        jumps = {"stop": self._pointer(stop), "stops": 1}
        inputs = self._new(f"{self.prefix}_inputs *", {"first": 0.0, "last": 2.0, "torque": torque, **jumps})
        return times, inputs, _motion(q, v, times)

    def _compared(self, what: str, number: int, answer: Array, rows: list[Array]) -> Iterator[str]:
        """Yield the first number that is wrong; with fused products numbers of ordinary size are looked at."""
        wanted = np.array(rows, self.dtype)
        right = (answer == wanted) & (np.signbit(answer) == np.signbit(wanted))
        if not self.bits:
            near = 1e4 * float(np.finfo(self.dtype).eps) * np.abs(wanted).max()
            right |= (np.abs(answer - wanted) <= near) | (number == len(STATES) - 1)
        if not right.all():
            row, place = np.unravel_index(int(np.argmin(right)), right.shape)
            said = f"{float(answer[row, place])!r} for {float(wanted[row, place])!r} at {place} behind step {row}"
            yield f"{what} gives {said} in state {number}"


def _motion(q: Array, v: Array, times: Array, short: int = 64) -> Array:
    """Return the motion under the signal, (samples + 1, 2 n), by short steps of rk4 in double precision."""
    equations = _Equations("float64")

    def rate(t: float, piece: int, x: Array) -> Array:
        s = t - KNOTS[piece]
        u = np.zeros((N, 1))
        u[DRIVEN] = sum(c * s**k for k, c in enumerate(PIECES[piece]))
        return np.concatenate([x[N:], equations.forward_dynamics(x[:N], x[N:], u)])

    x = np.concatenate([q, v]).astype(np.float64)[:, np.newaxis]
    rows = [x.ravel()]
    for begin, end in pairwise(times):
        piece, dt = int(begin >= KNOTS[1]), float(end - begin) / short
        for step in range(short):
            t = float(begin) + step * dt
            first = rate(t, piece, x)
            second = rate(t + 0.5 * dt, piece, x + 0.5 * dt * first)
            third = rate(t + 0.5 * dt, piece, x + 0.5 * dt * second)
            last = rate(t + dt, piece, x + dt * third)
            x = x + dt / 6.0 * (first + 2.0 * second + 2.0 * third + last)
        rows.append(x.ravel())
    return np.array(rows)
