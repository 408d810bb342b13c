"""The process of one version: it reads a request a line, JSON, and answers with one.

Its own eomgen comes first on the path, of which it uses the public API alone, so that all versions are measured alike.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

SAMPLE = 1e7  # ns of CPU time that a sample takes at least
WARM = 3  # passes before the first sample: the first ones compile and load
COMPARED = 16  # states of a batch whose results are compared

Call = Callable[[], None]  # one pass through the arguments of a row
Bind = Callable[[], Call]  # looks the method up anew: a kernel may exchange it once faster code is there


def prepare(request: Mapping[str, Any], kernels: dict[str, Any]) -> tuple[Bind, dict[str, Any]]:
    """Build what a row needs and write its results; return what makes its call, and its operation counts."""
    import eomgen

    robot = request["robot"]
    if robot not in kernels:
        kernels[robot] = eomgen.build(eomgen.load_robot(robot, **request["options"]))
    kernel = kernels[robot]
    with np.load(request["inputs"]) as file:
        arrays = [file[name] for name in file.files]
    arguments = list(zip(*arrays, strict=True)) if request["each"] else [tuple(arrays)]
    function = function_of(kernel, request["call"], request["keywords"])
    results = [function(*each) for each in arguments]
    is_batch = request["out"] and not request["each"]
    np.save(request["results"], numbers(results[0][:COMPARED] if is_batch else results))
    out = {"out": np.empty_like(results[0])} if request["out"] else {}

    def bind() -> Call:
        method = partial(function_of(kernel, request["call"], request["keywords"]), **out)

        def call() -> None:
            for each in arguments:
                method(*each)

        return call

    for _ in range(WARM):
        bind()()
    counts = dict(kernel.operations.get(request["counts"], {}))
    steps = getattr(results[0], "info", None) or {x: getattr(results[0], x, 0) for x in ("steps", "rejected")}
    if isinstance(steps["steps"], int | np.integer) and steps["steps"]:
        counts["steps"] = int(steps["steps"] + steps["rejected"])
    return bind, {"counts": counts}


def function_of(kernel: Any, call: str, keywords: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the function that takes a row's arrays."""
    if call == "integrate":
        from eomgen.integration import integrate

        end, options = keywords["duration"], {key: keywords[key] for key in ("method", "rtol")}
        times = np.linspace(0.0, end, keywords["samples"] + 1)
        return lambda q, v, u: integrate(kernel, q, v, end, drive=u, times=times, **options)
    if call == "hessian":
        return lambda q, v, a, w: kernel.hessian("inverse_dynamics", (q, v, a), w)
    if call == "rollout_gradient":
        return partial(kernel.rollout_gradient, loss=final_sum, **keywords)
    if call.startswith("frame_"):
        return partial(getattr(kernel, call), frame=kernel.frames[-1])
    return partial(getattr(kernel, call), **keywords)


def final_sum(t: Any, q: Any, v: Any) -> tuple[float, Any, Any]:
    """Return the sum of the last coordinates, and its derivatives by all q and v."""
    by_q = np.zeros_like(q)
    by_q[-1] = 1.0
    return float(q[-1].sum()), by_q, np.zeros_like(v)


def numbers(result: Any) -> Any:
    """Return all numbers of an array, of a trajectory's coordinates, or of a sequence or mapping of these, (size,)."""
    if isinstance(result, Mapping):
        result = [result[key] for key in sorted(result)]
    if isinstance(result, Sequence):
        return np.concatenate([numbers(x) for x in result])
    return np.ravel(np.asarray(getattr(result, "q", result), dtype=float))


def sample(bind: Bind) -> float:
    """Return nanoseconds of CPU time of a call, the mean over SAMPLE, after one that does not count."""
    call = bind()

    def spend(again: int) -> float:
        begin = time.process_time_ns()
        for _ in range(again):
            call()
        return (time.process_time_ns() - begin) / again

    return spend(max(1, math.ceil(SAMPLE / max(spend(1), 1.0))))


def main() -> None:
    """Answer requests until there are no more; one with the name of a prepared row alone asks for a sample."""
    import eomgen

    if not str(eomgen.__file__).startswith(sys.argv[1]):
        sys.exit(f"eomgen comes from {eomgen.__file__}, not from {sys.argv[1]}")
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what compilers print is no answer
    kernels: dict[str, Any] = {}
    prepared: dict[str, Bind] = {}
    for line in sys.stdin:
        request = json.loads(line)
        name = request["name"]
        try:
            if name in prepared:
                answer: dict[str, Any] = {"ns": sample(prepared[name])}
            else:
                prepared[name], answer = prepare(request, kernels)
        except Exception as error:  # whatever a version raises, the row says it
            answer = {"missing": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
