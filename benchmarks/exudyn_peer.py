"""Exudyn's rotor: its reduced-order body of the same finite elements and modes, in its own bearings and solvers."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags

from eomgen.arrays import Array

from .peers.contender import MissingPeer
from .rotor_model import BEARINGS, DAMPING, SPEED, STIFFNESS, Rotor


@dataclass(frozen=True)
class Settings:
    """Of its time integration: solver by its name, equal steps, spectral radius; whether Newton's matrix is kept."""

    solver: str
    steps: int
    radius: float = 0.5
    modified: bool = True

    @property
    def label(self) -> str:
        """What a table says of it, but the number of steps."""
        is_alpha = self.solver == "GeneralizedAlpha"
        words = f"generalized alpha, spectral radius {self.radius:g}" if is_alpha else "trapezoidal"
        return f"{words}, {'modified' if self.modified else 'full'} Newton"


def version() -> str:
    """Return the version of the wheel.

    Raises:
        MissingPeer: it is not installed.
    """
    if importlib.util.find_spec("exudyn") is None:
        raise MissingPeer("the wheel exudyn is not installed")
    return importlib.metadata.version("exudyn")


def motion(rotor: Rotor, settings: Settings, duration: float, samples: int) -> tuple[Array, float]:
    """Return places of the rotor's middle at equal times, (samples + 1, 3), and the processor time of the solver, s."""
    exu, fem = (importlib.import_module(name) for name in ("exudyn", "exudyn.FEM"))
    items = importlib.import_module("exudyn.itemInterface")
    system = exu.SystemContainer().AddSystem()
    body = _body(exu, fem, rotor).AddObjectFFRFreducedOrder(
        system, positionRef=[0.0] * 3, initialVelocity=[0.0] * 3, initialAngularVelocity=[0.0, 0.0, SPEED]
    )["oFFRFreducedOrder"]
    ground = system.AddObject(items.ObjectGround(referencePosition=[0.0] * 3))
    for members, (z, along) in zip(rotor.ends, BEARINGS.values(), strict=True):
        fixed = system.AddMarker(items.MarkerBodyPosition(bodyNumber=ground, localPosition=[0.0, 0.0, z]))
        moving = system.AddMarker(
            items.MarkerSuperElementPosition(
                bodyNumber=body, meshNodeNumbers=members, weightingFactors=np.full(len(members), 1.0 / len(members))
            )
        )
        springs = {"stiffness": [STIFFNESS, STIFFNESS, along], "damping": [DAMPING] * 3}
        system.AddObject(items.CartesianSpringDamper(markerNumbers=[moving, fixed], **springs))
    sensor = system.AddSensor(
        items.SensorSuperElement(
            bodyNumber=body,
            meshNodeNumber=rotor.middle,
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.Position,
        )
    )
    system.Assemble()
    options = exu.SimulationSettings()
    options.solutionSettings.writeSolutionToFile = False
    options.solutionSettings.sensorsWritePeriod = duration / samples
    steps = options.timeIntegration
    steps.numberOfSteps, steps.endTime, steps.verboseMode = settings.steps, duration, 0
    steps.newton.useModifiedNewton = settings.modified
    steps.generalizedAlpha.spectralRadius = settings.radius
    began = time.process_time()
    system.SolveDynamic(options, solverType=getattr(exu.DynamicSolverType, settings.solver))
    seconds = time.process_time() - began
    return np.array(system.GetSensorStoredData(sensor))[:, 1:], seconds


def _body(exu: Any, fem: Any, rotor: Rotor) -> Any:
    """Return its interface of a body with modes, out of its interface of finite elements."""
    elements = fem.FEMinterface()
    elements.nodes = {"Position": rotor.nodes}
    elements.massMatrix = csr_matrix(diags(np.repeat(rotor.masses, 3)))
    elements.stiffnessMatrix = csr_matrix(rotor.K)
    elements.modeBasis = {"matrix": rotor.modes, "type": "NormalModes"}
    return fem.ObjectFFRFreducedOrderInterface(elements, rigidBodyNodeType=exu.NodeType.RotationEulerParameters)
