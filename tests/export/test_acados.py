"""Models of acados: their C, called as acados calls it, against rollouts; with the BLASFEO of CasADi's wheel."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.adapters.casadi import kernels_for_step, step
from eomgen.codegen.package.compile import WARNINGS
from eomgen.errors import InputError, UnknownNameError
from eomgen.export import export_acados
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.optional import module_of, needs
from tests.support.random_robots import Array, random_robot
from tests.support.refusals import refused

casadi = needs("casadi")

WHEEL = Path(casadi.__file__).parent
# What acados declares of generic external functions, in the file of this name
ARGUMENTS = """
struct blasfeo_dmat;
struct blasfeo_dvec;
struct blasfeo_dmat_args { struct blasfeo_dmat *A; int ai; int aj; };
struct blasfeo_dvec_args { struct blasfeo_dvec *x; int xi; };
"""
# Reads x, u and p, calls both functions with offsets in all matrices, and prints statuses, states and [jac_u'; jac_x']
CALLER = """
#include <stdio.h>
#include <stdlib.h>
#include "blasfeo_d_aux.h"
#include "blasfeo_d_aux_ext_dep.h"
#include "acados/utils/external_function_generic.h"
int NAME_disc_fun(void **in, void **out, void *params);
int NAME_disc_fun_jac(void **in, void **out, void *params);
int main(void)
{
    double p[NP + 1];
    struct blasfeo_dvec xu, end;
    struct blasfeo_dmat by;
    blasfeo_allocate_dvec(NX + NU + 1, &xu);
    blasfeo_allocate_dvec(NX + 2, &end);
    blasfeo_allocate_dmat(NX + NU + 3, NX + 2, &by);
    for (int i = 0; i < NX + NU; ++i) {
        const int place = (i < NX) ? NU + i + 1 : i - NX + 1;
        if (scanf("%lf", &BLASFEO_DVECEL(&xu, place)) != 1) return 1;
    }
    for (int i = 0; i < NP; ++i) if (scanf("%lf", &p[i]) != 1) return 1;
    struct blasfeo_dvec_args x_in = { &xu, NU + 1 }, u_in = { &xu, 1 }, x_out = { &end, 2 };
    struct blasfeo_dmat_args by_out = { &by, 3, 2 };
    void *in[] = { &x_in, &u_in }, *out[] = { &x_out, &by_out };
    printf("%d\\n", NAME_disc_fun(in, out, p));
    for (int i = 0; i < NX; ++i) printf("%.17g\\n", BLASFEO_DVECEL(&end, 2 + i));
    printf("%d\\n", NAME_disc_fun_jac(in, out, p));
    for (int i = 0; i < NX; ++i) printf("%.17g\\n", BLASFEO_DVECEL(&end, 2 + i));
    for (int i = 0; i < NU + NX; ++i)
        for (int j = 0; j < NX; ++j) printf("%.17g\\n", BLASFEO_DMATEL(&by, 3 + i, 2 + j));
    return 0;
}
"""


class Called:
    """The functions of an exported model in a program of their own."""

    def __init__(self, folder: Path, robot: Robot, **options: Any) -> None:
        self.files = export_acados(robot, folder, **options)
        self.made = module_of(self.files[1])
        self.sizes = [len(x) for x in (self.made.STATES, self.made.DRIVES, self.made.PARAMETERS)]
        declared = folder / "acados" / "utils" / "external_function_generic.h"
        declared.parent.mkdir(parents=True)
        declared.write_text(ARGUMENTS, encoding="ascii")
        text = CALLER.replace("NAME", robot.name)
        for name, size in zip(("NX", "NU", "NP"), self.sizes, strict=True):
            text = text.replace(name, str(size))
        (folder / "caller.c").write_text(text, encoding="ascii")
        include = [f"-isystem{WHEEL / 'include'}", f"-isystem{folder}"]
        compiler = shutil.which("cc") or "gcc"
        objects = [str(folder / "model.o"), str(folder / "caller.o")]
        for source, made, warn in zip((self.files[0], folder / "caller.c"), objects, (True, False), strict=True):
            warnings = [*WARNINGS, "-Werror"] if warn else ["-std=c99"]
            subprocess.run([compiler, "-O0", *warnings, *include, "-c", str(source), "-o", made], check=True)
        self.program = folder / "caller"
        link = [f"-L{WHEEL}", "-lblasfeo", f"-Wl,-rpath,{WHEEL}", "-lm"]
        subprocess.run([compiler, *objects, *link, "-o", str(self.program)], check=True)

    def __call__(self, x: Array, u: Array, p: Array) -> tuple[list[int], Array, Array, Array]:
        """Both statuses, the state of both functions, and derivatives by u, then by x, (numbers, states)."""
        given = " ".join(repr(float(number)) for number in np.concatenate([x, u, p]))
        done = subprocess.run([str(self.program)], input=given, capture_output=True, text=True, check=True)
        numbers = np.array([float(word) for word in done.stdout.split()])
        nx, nu, _ = self.sizes
        first, second, by = np.split(numbers, [1 + nx, 2 + 2 * nx])
        return [int(first[0]), int(second[0])], first[1:], second[1:], by.reshape(nu + nx, nx)


@pytest.mark.skipif(sys.platform == "win32", reason="links with a shared library by its name")
@pytest.mark.parametrize(
    ("name", "method", "parameters"),
    [
        ("one_link", "rk4", ("joints.joint1.x.stiffness",)),
        pytest.param("one_link", "auto", (), marks=pytest.mark.soak),
        pytest.param("four_bar", "implicit", (), marks=pytest.mark.soak),
        pytest.param("ur5", "auto", ("gravity.z",), marks=pytest.mark.soak),
    ],
)
def test_functions_of_acados(name: str, method: str, parameters: tuple[str, ...], built: Build, tmp_path: Path) -> None:
    """Called as acados calls them: the step of CasADi, its derivatives, and parameters that change."""
    robot = eomgen.load_robot(name)
    called = Called(tmp_path, robot, method=method, step=4e-3, substeps=2, parameters=parameters)
    chosen = {"one_link": "rosenbrock", "ur5": "rk4"}[name] if method == "auto" else method
    assert f"by the method {chosen}" in str(called.made.__doc__)
    kernel = built(robot, *kernels_for_step(chosen, closed=bool(robot.loops)))
    assert (*kernel.coordinates, *kernel.coordinates) == called.made.STATES
    assert {key: kernel.parameters[key] for key in parameters} == called.made.PARAMETERS
    made = step(kernel, chosen, dt=4e-3, substeps=2, parameters=parameters, flags=("-O0",))
    home = np.array(build_model(robot).home)
    x = np.concatenate([home + (0.0 if robot.loops else 0.1), np.full(kernel.n, 0.0 if robot.loops else 0.2)])
    u, p = np.linspace(1.0, 2.0, called.sizes[1]), np.array([1.1 * kernel.parameters[key] for key in parameters])
    statuses, alone, state, by = called(x, u, p)
    arrays = (x, u, p) if parameters else (x, u)
    assert statuses == [0, 0]
    assert np.array_equal(alone, np.array(made(*arrays)).ravel())
    assert np.array_equal(state, alone)
    by_x, by_u = (np.array(block) for block in made.jacobian()(*arrays, 0)[:2])
    assert np.allclose(by, np.hstack([by_u, by_x]).T, rtol=0.0, atol=1e-14 * max(1.0, np.abs(by).max()))


def test_the_model(built: Build, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What acados_template takes, and what is said where the C is elsewhere."""
    files = export_acados("one_link", tmp_path / "here", method="rk4", parameters=("joints.joint1.x.stiffness",))
    made = module_of(files[1])
    template = ModuleType("acados_template")
    template.AcadosModel = SimpleNamespace  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "acados_template", template)
    monkeypatch.chdir(tmp_path)
    refused(FileNotFoundError, r"one_link_acados\.c is not in .*; run Python in its folder", made.model)
    monkeypatch.chdir(tmp_path / "here")
    model = made.model()
    assert (model.name, model.dyn_ext_fun_type, model.dyn_generic_source) == ("one_link", "generic", files[0].name)
    assert [(x.shape) for x in (model.x, model.u, model.p)] == [(4, 1), (1, 1), (1, 1)]
    for function in (model.dyn_disc_fun, model.dyn_disc_fun_jac):
        assert f"\nint {function}(void **in, void **out, void *params)\n" in files[0].read_text(encoding="ascii")
    assert made.STEP == 0.01
    assert '#include "clib' not in files[0].read_text(encoding="ascii")
    with pytest.raises(InputError, match="method: 'radau' has no derivatives; allowed: rk4, tsit5"):
        export_acados("one_link", tmp_path, method="radau")
    with pytest.raises(UnknownNameError, match=r"parameters: 'mass' is unknown"):
        export_acados("one_link", tmp_path, method="rk4", parameters=("mass",))


@pytest.mark.soak
@pytest.mark.skipif(sys.platform == "win32", reason="links with a shared library by its name")
def test_a_step_that_fails_is_not_finite(tmp_path: Path) -> None:
    """Where angles of a free body are singular: acados asks for no status, but sees NaN."""
    robot = random_robot(976, joints=(1, 1), types=("free",), armature=False)
    called = Called(tmp_path, robot, method="rk4")
    x = np.zeros(called.sizes[0])
    x[called.made.STATES.index("joint1.beta")] = np.pi / 2
    statuses, alone, state, by = called(x, np.zeros(called.sizes[1]), np.zeros(0))
    assert statuses == [1, 1]
    assert all(np.isnan(numbers).all() for numbers in (alone, state, by))
