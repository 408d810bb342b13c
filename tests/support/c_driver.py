"""A program in C that calls every kernel of a generated source, alone, without Python: for sanitizers and guards.

Every array that a kernel gets lies on the heap, exactly as long as it may be.  The program reads parameters and states
from a file, and writes what the kernels made of them.  Macros choose what it watches:

    THREADS     so many threads do the same at once, with one h, and must find the same bits
    GUARDED     an allocation during a call aborts the program, whoever makes it
    WATCHED     the control part of the floating-point environment must be the same after every call, in all rounding
                modes and with denormals flushed by the caller
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.c.source import Source
from tests.support.c_project import write_source

Array = NDArray[Any]
STATES = 19  # no multiple of any number of lanes
COUNTS = (1, 5, STATES)  # of batches
ALONE = (0, 9, STATES - 1)  # those that are done alone, too
STEPS, EVERY, DT = 6, 2, 1e-5
ROWS = {"u": 5 * STEPS}  # drives of a rollout differ from step to step
LABELS = ("q", "v", "a", "u", "wrench", "z")

HEAD = r"""
#define _GNU_SOURCE
#include <fenv.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "@name@.h"

typedef @real@ real;
enum { STATES = @states@, SIZE = @size@, COORDINATES = @n@, INTERNAL = @m@ };
typedef struct { real *numbers; size_t used; } Sink;
static real *parameters, *h, *all_q, *all_v, *all_a, *all_u, *all_wrench, *all_z, *all_kp, *all_kd, *all_path;
static __thread int inside;

static void stop(const char *why)
{
    inside = 0;
    fprintf(stderr, "%s\n", why);
    abort();
}

#ifdef GUARDED
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void __libc_free(void *);
#define REFUSE if (inside) stop("allocation during a call")
void *malloc(size_t n) { REFUSE; return __libc_malloc(n); }
void *calloc(size_t n, size_t k) { REFUSE; return __libc_calloc(n, k); }
void *realloc(void *p, size_t n) { REFUSE; return __libc_realloc(p, n); }
void free(void *p) { REFUSE; __libc_free(p); }
#endif

/* Rounding, masks, flushing of denormals; of SSE and of the x87. */
static unsigned control(void)
{
    unsigned found = (unsigned)fegetround();
#if defined(__x86_64__)
    unsigned short word;
    __asm__ volatile("fnstcw %0" : "=m"(word));
    found ^= (__builtin_ia32_stmxcsr() & 0xffc0U) << 16 ^ word;
#endif
    return found;
}

static volatile double tiny = 5e-324;
static int denormals(void) { return tiny * 1.0 != 0.0; }

#ifdef WATCHED
#define CALL(call) do { \
    const unsigned before = control(); const int kept = denormals(); \
    inside = 1; status = (long long)(call); inside = 0; \
    if (control() != before || denormals() != kept) stop("floating-point environment changed by " #call); } while (0)
#else
#define CALL(call) do { inside = 1; status = (long long)(call); inside = 0; } while (0)
#endif

/* Memory of exactly so many numbers, from x or filled with what no kernel writes. */
static real *room(size_t count, const real *x)
{
    real *found = malloc(count * sizeof *found);
    if (!found && count) stop("no memory");
    if (x) memcpy(found, x, count * sizeof *found);
    else memset(found, 0x5b, count * sizeof *found);
    return found;
}

/* Velocities and internal states behind them, of several states, as rollouts take them. */
static real *rates(size_t count, size_t state)
{
    enum { RATES = COORDINATES + INTERNAL };
    real *found = room(count * RATES, NULL);
    for (size_t i = 0; i < count; ++i) {
        memcpy(found + i * RATES, all_v + (state + i) * COORDINATES, COORDINATES * sizeof *found);
        memcpy(found + i * RATES + COORDINATES, all_z + (state + i) * INTERNAL, INTERNAL * sizeof *found);
    }
    return found;
}

static void put(Sink *sink, long long status, int failed, const real *x, size_t count)
{
    if (sink->used + count + 1 > SIZE) stop("more results than expected");
    sink->numbers[sink->used++] = (real)status;
    if (failed) memset(sink->numbers + sink->used, 0, count * sizeof *x);
    else memcpy(sink->numbers + sink->used, x, count * sizeof *x);
    sink->used += count;
}
"""

TAIL = r"""
static void compute(Sink *sink)
{
    sink->numbers = malloc(SIZE * sizeof(real));
    if (!sink->numbers) stop("no memory");
    sink->used = 0;
@calls@
}

static void *run(void *sink) { compute(sink); return NULL; }

#ifdef WATCHED
static void watch(const char *why)
{
    Sink sink;
    const unsigned before = control();
    compute(&sink);
    free(sink.numbers);
    if (control() != before) stop(why);
}
#endif

int main(int count, char **arguments)
{
    static const size_t sizes[] = { @sizes@ };
    real **arrays[] = { &parameters, &all_q, &all_v, &all_a, &all_u, &all_wrench, &all_z, &all_kp, &all_kd, &all_path };
    Sink sink;
    FILE *file = fopen(arguments[1], "rb");
    if (count < 3 || !file) stop("no input");
    for (int i = 0; i < 10; ++i) {
        *arrays[i] = room(sizes[i], NULL);
        if (fread(*arrays[i], sizeof(real), sizes[i], file) != sizes[i]) stop("input is too short");
    }
    fclose(file);
    if (!denormals()) stop("denormals are flushed at the start");
    h = room(@hoisted@, NULL);
    long long status = 0;
    CALL((@name@_setup(parameters, h), 0));
    (void)status;
#ifdef GUARDED
    if (count > 3) { inside = 1; void *volatile x = malloc(3); free(x); } /* that the guard is awake */
#endif
#ifdef WATCHED
    static const int modes[] = { FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO };
    for (int i = 0; i < 3; ++i) {
        fesetround(modes[i]);
        watch("rounding changed");
        if (fegetround() != modes[i]) stop("rounding changed");
    }
    fesetround(FE_TONEAREST);
#if defined(__x86_64__)
    const unsigned normal = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(normal | 0x8040U); /* denormals are zero, and flushed */
    if (denormals()) stop("denormals are not flushed on request");
    watch("flushing of denormals changed");
    __builtin_ia32_ldmxcsr(normal);
#endif
#endif
    compute(&sink);
#ifdef THREADS
    pthread_t threads[THREADS];
    Sink sinks[THREADS];
    for (int i = 0; i < THREADS; ++i)
        if (pthread_create(threads + i, NULL, run, sinks + i)) stop("no thread");
    for (int i = 0; i < THREADS; ++i) {
        pthread_join(threads[i], NULL);
        if (sinks[i].used != sink.used || memcmp(sinks[i].numbers, sink.numbers, sink.used * sizeof(real)))
            stop("a thread found something else");
        free(sinks[i].numbers);
    }
#else
    (void)run;
#endif
    file = fopen(arguments[2], "wb");
    if (!file || fwrite(sink.numbers, sizeof(real), sink.used, file) != sink.used || fclose(file)) stop("no output");
    free(sink.numbers);
    free(h);
    for (int i = 0; i < 10; ++i) free(*arrays[i]);
    return 0;
}
"""


@dataclass(frozen=True)
class Call:
    """One call: its name, states (None: a single one, of that number), and the length of its results.

    shared: whether the last array of a batch is one state for all.  frame: its number, or None.  how: of a rollout
    whether there is a controller, and the method.
    """

    name: str
    reads: tuple[str, ...]
    size: int
    count: int | None
    state: int = 0
    shared: bool = False
    frame: int | None = None
    how: tuple[bool, int] | None = None

    @property
    def length(self) -> int:
        """Numbers in the output: a status, and the results."""
        return 1 + self.size * (self.count or 1)


def calls_of(meta: Mapping[str, Any]) -> Iterator[Call]:
    """All calls of a driver, in their order."""
    shapes = {key: int(np.prod(shape)) for key, shape in meta["shapes"].items()}
    n, m = numbers_of(meta)
    functions = {name: meta["functions"][name] for name in meta["kernels"] if name in meta["functions"]}
    kernels = [(name, tuple(k["reads"]), shapes[k["writes"]], (None,)) for name, k in functions.items()]
    kernels = [entry for entry in kernels if entry[0] not in ("kinematics", "rollout", "adaptive_rollout")]
    kernels = [entry for entry in kernels if set(entry[1]) <= set(LABELS)]  # a chart is no random array: it has indices
    if "kinematics" in meta["kernels"]:
        frames = tuple(range(len(meta["frames"])))
        kernels += [("frame_pose", ("q",), 16, frames), ("frame_jacobian", ("q",), 6 * n, frames)]
    for name, reads, size, frames in kernels:
        for frame in frames:
            for state in ALONE:
                yield Call(name, reads, size, None, state, frame=frame)
            for count in COUNTS:
                yield Call(name, reads, size, count, frame=frame)
            if len(reads) > 1:
                yield Call(name, reads, size, 5, shared=True)
    if "rollout" in meta["kernels"]:
        for method in (0, 1):
            for controlled in (False, True):
                for count in (None, 5):
                    rows = STEPS // EVERY + 1
                    yield Call("rollout", ("q", "v", "u"), (2 * n + m) * rows, count, how=(controlled, method))


def numbers_of(meta: Mapping[str, Any]) -> tuple[int, int]:
    """Numbers of coordinates and of internal states."""
    return len(meta["coordinates"]), len(meta.get("internal_states", ()))


def sizes_of(meta: Mapping[str, Any]) -> dict[str, int]:
    """How many numbers of one state each array has."""
    return {label: int(np.prod(meta["shapes"].get(label, 0))) for label in LABELS}


def driver_text(source: Source) -> str:
    """main.c for the source."""
    meta = json.loads(source.meta)
    calls = list(calls_of(meta))
    size, (n, m) = sizes_of(meta), numbers_of(meta)
    lengths = [len(meta["parameters"]), *(ROWS.get(label, STATES) * size[label] for label in LABELS), n, n, STEPS * n]
    words = {
        "name": source.name,
        "real": {"float64": "double", "float32": "float"}[meta["dtype"]],
        "states": STATES,
        "n": n,
        "m": m,
        "size": sum(call.length for call in calls),
        "hoisted": meta["hoisted"],
        "sizes": ", ".join(map(str, lengths)),
    }
    functions = "\n".join(_function(source.name, i, call, size, n) for i, call in enumerate(calls))
    words["calls"] = "\n".join(f"    call{i}(sink);" for i in range(len(calls)))
    text = HEAD + functions + TAIL
    for key, value in words.items():
        text = text.replace(f"@{key}@", str(value))
    return text


def _function(name: str, i: int, call: Call, size: Mapping[str, int], n: int) -> str:
    """The C of one call."""
    lines = [f"\nstatic void call{i}(Sink *sink)", "{", "    long long status;"]
    arguments = ["h"] if call.count is None or call.how else [f"{call.count}", "h"]
    if call.how and call.count is not None:
        arguments.insert(0, f"{call.count}")
    arrays = ["out"]
    for position, label in enumerate(call.reads):
        one = call.count is None or (call.shared and position == len(call.reads) - 1)
        count = size[label] * (1 if one else call.count or 1) * (STEPS if call.how and label == "u" else 1)
        first = size[label] * call.state if not (call.how and label == "u") else 0
        made = f"room({count}, all_{label} + {first})"
        if call.how and label == "v":
            made = f"rates({call.count or 1}, {call.state})"
        lines.append(f"    real *{label} = {made};")
        arrays.append(label)
        if not (call.how and label == "u"):
            arguments.append(label)
            if call.count is not None:
                step = size["v"] + size["z"] if call.how and label == "v" else size[label]
                arguments.append("0" if one else str(step))
    lines.append(f"    real *out = room({call.size * (call.count or 1)}, NULL);")
    if call.frame is not None:
        arguments.append(str(call.frame))
    if call.how:
        controlled, method = call.how
        fields = f"u, {STEPS * n if call.count else 0}, {n}, "
        if controlled:
            for label, count in (("kp", n), ("kd", n), ("path", STEPS * n)):
                lines.append(f"    real *{label} = room({count}, all_{label});")
                arrays.append(label)
            fields += f"kp, kd, path, 0, {n}"
        else:
            fields += "NULL, NULL, NULL, 0, 0"
        lines.append(f"    const {name}_drive drive = {{ {fields} }};")
        arguments += ["&drive", f"(real){DT!r}", str(STEPS), str(EVERY), str(method)]
        arguments += ["out", f"out + {n * (STEPS // EVERY + 1) * (call.count or 1)}"]
    else:
        arguments.append("out")
    suffix = "_batch" if call.count is not None else ""
    good = -1 if call.count is not None or call.how else 0
    lines.append(f"    CALL({name}_{call.name}{suffix}({', '.join(arguments)}));")
    lines.append(f"    put(sink, status, status != {good}, out, {call.size * (call.count or 1)});")
    lines += [f"    free({array});" for array in arrays]
    return "\n".join([*lines, "}"])


def inputs_of(source: Source, spread: Array, seed: int = 1) -> dict[str, Array]:
    """Random inputs by label, (STATES, size) of states.

    Args:
        spread: how far each coordinate goes from 0, (n,), m or rad; internal states stay short.
    """
    meta, rng = json.loads(source.meta), np.random.default_rng(seed)
    (n, m), dtype = numbers_of(meta), np.dtype(meta["dtype"])
    found = {"p": np.array(list(meta["parameters"].values()))}
    found |= {label: rng.uniform(-2.0, 2.0, (ROWS.get(label, STATES), size)) for label, size in sizes_of(meta).items()}
    found["q"] = spread * rng.uniform(-1.0, 1.0, (STATES, n))
    found["v"] = np.minimum(spread, 1.0) * rng.uniform(-1.0, 1.0, (STATES, n))
    found["z"] = 1e-4 * rng.uniform(-1.0, 1.0, (STATES, m))
    gains = np.zeros((2, n))
    gains[:, list(meta["driven"])] = rng.uniform(0.1, 2.0, (2, len(meta["driven"])))
    found |= {"kp": gains[0], "kd": gains[1], "path": spread * rng.uniform(-1.0, 1.0, (STEPS, n))}
    return {label: np.ascontiguousarray(array, dtype) for label, array in found.items()}


def write_driver(source: Source, inputs: Mapping[str, Array], folder: Path) -> None:
    """Source, main.c and input.bin."""
    write_source(source, folder)
    (folder / "main.c").write_text(driver_text(source), encoding="ascii")
    (folder / "input.bin").write_bytes(b"".join(array.tobytes() for array in inputs.values()))


def compile_driver(
    source: Source, folder: Path, compiler: str, flags: Sequence[str], target: str, macros: Sequence[str] = ()
) -> Path:
    """The program, in the folder of ``write_driver``; flags go to all of it, macros to main.c alone."""
    program = folder / target
    objects = objects_of(source, program)
    watching = [flag for flag in flags if flag.startswith("-fsanitize")]
    main = folder / f"main{'_'.join([*watching, *macros])}.o"
    optimized = [flag for flag in flags if not flag.startswith("-O")]
    for code, made in zip(source.codes, objects, strict=True):
        _run([compiler, "-std=c99", *flags, "-c", str(folder / code), "-o", str(made)])
    if not main.exists():  # the same for all compilers
        main_flags = ["-std=gnu99", *watching, "-w", *(f"-D{macro}" for macro in macros)]
        _run([compiler, *main_flags, "-c", str(folder / "main.c"), "-o", str(main)])
    _run([compiler, *optimized, *map(str, objects), str(main), "-o", str(program), "-lm", "-pthread"])
    return program


def objects_of(source: Source, program: Path) -> list[Path]:
    """The objects of a source's files that a program of ``compile_driver`` was linked of."""
    return [program.with_name(f"{program.name}_{Path(code).stem}.o") for code in source.codes]


def run_driver(program: Path, source: Source, *extra: str, environment: Mapping[str, str] | None = None) -> Array:
    """All that the program found, status and results of one call after the other."""
    out = program.with_suffix(".out")
    _run([str(program), str(program.parent / "input.bin"), str(out), *extra], environment)
    return np.fromfile(out, json.loads(source.meta)["dtype"])


def _run(command: list[str], environment: Mapping[str, str] | None = None) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert result.returncode == 0, f"{' '.join(command)}: {result.returncode}\n{result.stdout}{result.stderr}"[:6000]


def results_by_call(source: Source, found: Array) -> Iterator[tuple[Call, int, Array]]:
    """Every call with its status and its results."""
    at = 0
    for call in calls_of(json.loads(source.meta)):
        yield call, int(found[at]), found[at + 1 : at + call.length]
        at += call.length
    assert at == found.size
