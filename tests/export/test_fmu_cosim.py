"""Mock-up units in a second importer, libcosim of the Open Simulation Platform: the motions of SciPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.export.fmu.pack import export_fmu

STEP, STEPS = 0.01, 100  # s


@pytest.mark.soak
@pytest.mark.parametrize("name", ["one_link", "puma560"])
def test_units_move_under_a_master_of_fixed_steps(name: str, tmp_path: Path) -> None:
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    unit = export_fmu(name, tmp_path / f"{name}.fmu", 2)
    kernel = eomgen.build(name)
    execution = CosimExecution.from_step_size(round(STEP * 1e9))
    place = execution.add_local_slave(CosimLocalSlave(fmu_path=str(unit), instance_name="arm"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    variables = execution.slave_variables(slave_index=place)
    known = {x.name.decode(): x.reference for x in variables}
    rng = np.random.default_rng(4)
    u = np.zeros(kernel.n)
    for i, coordinate in enumerate(kernel.coordinates):
        if f"u.{coordinate}" in known:
            u[i] = rng.uniform(-2.0, 2.0)
            assert execution.real_initial_value(place, known[f"u.{coordinate}"], float(u[i]))
    assert execution.step(STEPS)
    found = observer.last_real_values(place, [known[f"q.{x}"] for x in kernel.coordinates])

    def slope(_: float, x: np.ndarray) -> np.ndarray:
        q, v = np.split(x, 2)
        return np.concatenate([v, kernel.forward_dynamics(q, v, u)])

    motion = solve_ivp(slope, (0.0, STEP * STEPS), np.zeros(2 * kernel.n), method="DOP853", rtol=1e-10, atol=1e-12)
    expected = motion.y[: kernel.n, -1]
    assert np.abs(expected).max() > 1e-2
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)
