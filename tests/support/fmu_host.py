"""Functional mock-up units as another tool runs them: one face over fmpy's classes of both versions and kinds."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support.optional import needs
from tests.support.refusals import refused

fmpy = needs("fmpy", "fmpy.fmi2", "fmpy.fmi3", "fmpy.validation")
fmi2, fmi3 = fmpy.fmi2, fmpy.fmi3
Array = NDArray[np.float64]
CLASSES = {(2, False): fmi2.FMU2Model, (2, True): fmi2.FMU2Slave, (3, False): fmi3.FMU3Model, (3, True): fmi3.FMU3Slave}


class Host:
    """An instance of a unit in a folder that it was unpacked to.

    ``references`` are value references by name, ``states`` the number of states, ``messages`` what was logged.
    """

    def __init__(self, folder: Path, *, stepping: bool = False, guid: str = "") -> None:
        self.description: Any = fmpy.read_model_description(str(folder), validate=False)
        self.version = int(self.description.fmiVersion[0])
        self.references: dict[str, int] = {x.name: x.valueReference for x in self.description.modelVariables}
        self.states = len(self.description.derivatives)
        self.messages: list[str] = []
        self.unit: Any = CLASSES[self.version, stepping](
            guid=guid or self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.modelName,
            instanceName="unit",
        )
        if self.version == 2:
            self._logger = fmi2.fmi2CallbackLoggerTYPE(lambda *said: self.messages.append(said[4].decode()))
            self._callbacks = fmi2.fmi2CallbackFunctions()
            self._callbacks.logger = self._logger
            self._callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
            self._callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
            self.unit.instantiate(callbacks=self._callbacks)
        else:
            self.unit.instantiate(logMessage=lambda *said: self.messages.append(said[3].decode()))

    def start(self, names: Sequence[str] = (), values: Sequence[float] = (), begin: float = 0.0) -> Host:
        """Set start values and go through initialization."""
        if self.version == 2:
            self.unit.setupExperiment(startTime=begin)
            self.unit.enterInitializationMode()
        else:
            self.unit.enterInitializationMode(startTime=begin)
        self.set(names, values)
        self.unit.exitInitializationMode()
        return self

    def numbers(self, names: Sequence[str]) -> list[int]:
        return [self.references[name] for name in names]

    def names(self, kind: str) -> list[str]:
        """Names that begin with it, in their order."""
        return [name for name in self.references if name.startswith(kind)]

    def get(self, names: Sequence[str]) -> Array:
        call = self.unit.getReal if self.version == 2 else self.unit.getFloat64
        return np.array(call(self.numbers(names)))

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        call = self.unit.setReal if self.version == 2 else self.unit.setFloat64
        if len(names):
            call(self.numbers(names), [float(x) for x in values])

    def derivative(self, unknown: Sequence[str], known: Sequence[str], seed: Sequence[float]) -> Array:
        return np.array(
            self.unit.getDirectionalDerivative(self.numbers(unknown), self.numbers(known), [float(x) for x in seed])
        )

    def set_states(self, x: Array) -> None:
        values = np.ascontiguousarray(x)
        self.unit.setContinuousStates(values.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), values.size)

    def rates(self) -> Array:
        """Derivatives of the continuous states, (states,)."""
        out = np.empty(self.states)
        call = self.unit.getDerivatives if self.version == 2 else self.unit.getContinuousStateDerivatives
        call(out.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), out.size)
        return out

    def step(self, begin: float, length: float) -> None:
        self.unit.doStep(currentCommunicationPoint=begin, communicationStepSize=length)

    def refuses(self, said: str, call: Callable[..., Any], *arguments: Any) -> None:
        """Assert that a call fails, and that the last message says why."""
        refused(Exception, "fmi", call, *arguments)
        assert said in self.messages[-1]

    def to_continuous_time(self) -> None:
        """From event mode on."""
        (self.unit.newDiscreteStates if self.version == 2 else self.unit.updateDiscreteStates)()
        self.unit.enterContinuousTimeMode()
