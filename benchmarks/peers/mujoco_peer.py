"""MuJoCo through the C library and headers that its wheel brings."""

from __future__ import annotations

import importlib.metadata
import tempfile
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.package.compile import find_compiler
from eomgen.errors import BuildError, InputError
from eomgen.export.mujoco import mjcf
from eomgen.robot.value import Robot

from .contender import FFI, Contender, MissingPeer, address, build_library

Array = NDArray[np.float64]

NAME = "MuJoCo"
SOURCE = Path(__file__).with_suffix(".c")
TIME_STEP = 1e-3  # s
CODE: Mapping[str, tuple[str, str]] = {  # kernel -> function, what it is in MuJoCo
    "inverse_dynamics": ("mujoco_inverse_dynamics", "mj_inverse"),
    "forward_dynamics": ("mujoco_forward_dynamics", "mj_forward"),
    "step": ("mujoco_step", "mj_step, discrete"),
}
STEP = "discrete"  # the integrator of steps: implicit in position, as ours
CONTINUOUS = "implicitfast"  # with which mj_inverse and mj_forward are those of the motion, and not of its steps
FFI.cdef("void *mujoco_peer_load(const char *path, char *error);")
for _name, _ in CODE.values():
    FFI.cdef(f"void {_name}(void);")  # an address is all that is used
FFI.cdef(
    "long long mujoco_rollout(const double *h, double dt, long long steps, long long every,"
    " const double *q, const double *v, const double *u, double *q_out);"
    "void mujoco_gradient(const double *h, double dt, long long steps, double eps, int centered,"
    " const double *q, const double *v, const double *u, const double *w, double *work, double *out);"
)


def version() -> str:
    """Return the version of the wheel."""
    return importlib.metadata.version("mujoco")


def library() -> Path:
    """Return the compiled peer.

    Raises:
        MissingPeer: MuJoCo or the compiler is missing.
    """
    spec = find_spec("mujoco")
    if spec is None or spec.origin is None:
        raise MissingPeer("the wheel mujoco is not installed")
    folder = Path(spec.origin).parent
    libraries = sorted(folder.glob("libmujoco.so*"))
    if not libraries:
        raise MissingPeer("the wheel mujoco has no libmujoco.so")
    try:
        compiler = find_compiler()
    except BuildError as error:
        raise MissingPeer(str(error)) from None
    parts = [("-std=c99", "-O2", f"-I{folder / 'include'}", SOURCE.name)]
    link = (str(libraries[0]), f"-Wl,-rpath,{folder}")
    return build_library(
        "mujoco_peer",
        " ".join(compiler.command),
        parts,
        link,
        {SOURCE.name: SOURCE.read_text(encoding="ascii")},
        (version(),),
    )


class MujocoPeer:
    """A robot in MuJoCo; ``actuators``: with a motor per coordinate.

    Raises:
        MissingPeer: MuJoCo has no equal for something of the robot, or refuses it.
    """

    def __init__(self, robot: Robot, integrator: str = STEP, *, actuators: bool = False) -> None:
        self._library = FFI.dlopen(str(library()))
        try:
            text = mjcf(robot, TIME_STEP, integrator, actuators=actuators)
        except InputError as error:
            raise MissingPeer(f"refuses the robot: {error}") from None
        said = FFI.new("char[1000]")
        with tempfile.TemporaryDirectory(prefix="eomgen-bench-") as private:
            path = Path(private, "robot.xml")
            path.write_text(text, encoding="ascii")
            self._model = self._library.mujoco_peer_load(str(path).encode(), said)
        if self._model == FFI.NULL:
            text = FFI.string(said).decode(errors="replace").splitlines()[0]
            raise MissingPeer(f"refuses the robot: {text.removeprefix('Error: ')}")

    def contender(self, kernel: str) -> Contender:
        """Return MuJoCo's function for a kernel: a key of ``CODE``."""
        code = address(FFI, FFI.addressof(self._library, CODE[kernel][0]))
        return Contender(NAME, code, address(FFI, self._model), keeps_result=True, kept=self)

    def rollout(self, q: Array, v: Array, u: Array, dt: float, steps: int, every: int) -> Array:
        """Return coordinates after every so many steps of dt, s, (steps // every + 1, n), the beginning first.

        Raises:
            ArithmeticError: they are not finite any more.
        """
        out = np.empty((steps // every + 1, len(q)))
        arrays = [*(np.ascontiguousarray(x) for x in (q, v, u)), out]
        addresses = [FFI.cast("double *", x.ctypes.data) for x in arrays]
        done = self._library.mujoco_rollout(FFI.cast("double *", self._model), dt, steps, every, *addresses)
        if done < steps:
            raise ArithmeticError(f"{NAME} diverges after {done} steps of {dt:g} s")
        return out

    def gradient(
        self, q: Array, v: Array, u: Array, w: Array, dt: float, *, eps: float, centered: bool
    ) -> Callable[[], tuple[Array, Array, Array]]:
        """Return the call that gives derivatives of w . q at the end by q, v (n,) and drives (steps, n).

        Transition matrices of every step come from ``mjd_transitionFD``, in C as all of this.

        Args:
            q, v: the beginning, (n,).
            u: drives of every step, (steps, n); the model has actuators.
            w: weights of the end, (n,).
            dt: length of a step, s.
            eps, centered: of the differences.
        """
        steps, n = u.shape
        work, out = np.empty(steps * 6 * n * n + 2 * n), np.empty((2 + steps, n))
        arrays = [*(np.ascontiguousarray(x) for x in (q, v, u, w)), work, out]
        pointers, h = [FFI.cast("double *", x.ctypes.data) for x in arrays], FFI.cast("double *", self._model)

        def call() -> tuple[Array, Array, Array]:
            self._library.mujoco_gradient(h, dt, steps, eps, centered, *pointers)
            return arrays[-1][0], arrays[-1][1], arrays[-1][2:]

        return call
