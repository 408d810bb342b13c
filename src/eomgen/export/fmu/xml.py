"""Model descriptions and the build description of an FMU, by the Functional Mock-up Interface.

Source: Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0.4, Functional Mock-up Interface
Specification 3.0.1 (fmi-standard.org).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from eomgen._version import __version__

from .variables import TOLERANCE, UNITS, Layout, Variable, exponents

COMMUNICATION_STEP = 0.01  # s, proposed to who simulates
CLOSED = (
    "; loops are closed after every step of co-simulation, in model exchange by stabilised ordinary differential"
    " equations (violations decay with the time constant solver.closing)"
)
LOG_CATEGORY = ("logStatusError", "What went wrong")


@dataclass(frozen=True)
class Fmu:
    """An FMU as its description shows it: name (the model identifier), token, variables and C sources.

    ``closed``: whether it keeps loops or couplings closed.
    """

    name: str
    token: str
    layout: Layout
    sources: Sequence[str]
    closed: bool = False


def model_description(fmu: Fmu, version: int) -> bytes:
    """Return modelDescription.xml of version 2 or 3."""
    return _bytes(_version_2(fmu) if version == 2 else _version_3(fmu))


def build_description(fmu: Fmu) -> bytes:
    """Return sources/buildDescription.xml of version 3."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=fmu.name)
    files = SubElement(configuration, "SourceFileSet", language="C99")
    for name in fmu.sources:
        SubElement(files, "SourceFile", name=name)
    text = "functions without the model identifier in front of their names, as shared libraries have them"
    SubElement(files, "PreprocessorDefinition", name="FMI3_OVERRIDE_FUNCTION_PREFIX", value="1", description=text)
    SubElement(configuration, "Library", name="m", external="true", description="mathematics of C, where it is apart")
    return _bytes(root)


def _bytes(root: Element) -> bytes:
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _about(fmu: Fmu) -> dict[str, str]:
    return {
        "modelName": fmu.name,
        "description": f"Equations of motion of the robot {fmu.name}{CLOSED if fmu.closed else ''}",
        "generationTool": f"eomgen {__version__}",
        "variableNamingConvention": "flat",
    }


def _version_2(fmu: Fmu) -> Element:
    about = {"fmiVersion": "2.0", "guid": fmu.token, "numberOfEventIndicators": "0"}
    root = Element("fmiModelDescription", about | _about(fmu))
    common = {
        "modelIdentifier": fmu.name,
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    exchange = SubElement(root, "ModelExchange", common, completedIntegratorStepNotNeeded="true")
    stepping = SubElement(root, "CoSimulation", common, canHandleVariableCommunicationStepSize="true")
    for interface in (exchange, stepping):
        files = SubElement(interface, "SourceFiles")
        for name in fmu.sources:
            SubElement(files, "File", name=name)
    _common(root, fmu.layout)
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(fmu.layout.variables):
        said, numbers = _attributes(reference, variable)
        if variable.derivative is not None:
            numbers["derivative"] = str(variable.derivative + 1)
        SubElement(SubElement(variables, "ScalarVariable", said), "Real", numbers)
    structure = SubElement(root, "ModelStructure")
    for kind, references in _structure(fmu.layout).items():
        group = SubElement(structure, kind)
        for reference in references:
            dependencies = {} if kind == "InitialUnknowns" else _dependencies(fmu.layout, reference, 1)
            SubElement(group, "Unknown", {"index": str(reference + 1), **dependencies})
    return root


def _version_3(fmu: Fmu) -> Element:
    root = Element("fmiModelDescription", {"fmiVersion": "3.0", "instantiationToken": fmu.token} | _about(fmu))
    common = {
        "modelIdentifier": fmu.name,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
    }
    SubElement(root, "ModelExchange", common)
    SubElement(root, "CoSimulation", common, canHandleVariableCommunicationStepSize="true")
    _common(root, fmu.layout)
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(fmu.layout.variables):
        about, numbers = _attributes(reference, variable)
        if variable.derivative is not None:
            numbers["derivative"] = str(variable.derivative)
        SubElement(variables, "Float64", {**about, **numbers})
    structure = SubElement(root, "ModelStructure")
    names = {"Outputs": "Output", "Derivatives": "ContinuousStateDerivative", "InitialUnknowns": "InitialUnknown"}
    for kind, unknowns in _structure(fmu.layout).items():
        for reference in unknowns:
            dependencies = {} if kind == "InitialUnknowns" else _dependencies(fmu.layout, reference, 0)
            SubElement(structure, names[kind], {"valueReference": str(reference), **dependencies})
    return root


def _common(root: Element, layout: Layout) -> None:
    """Add elements that both versions have between interface types and variables."""
    variables = layout.variables
    used = {variable.unit for variable in variables}
    units = SubElement(root, "UnitDefinitions")
    for name in (*(x for x in UNITS if x in used), *sorted(used - UNITS.keys())):
        powers = {base: str(power) for base, power in exponents(name).items()}
        SubElement(SubElement(units, "Unit", name=name), "BaseUnit", powers)
    category, text = LOG_CATEGORY
    SubElement(SubElement(root, "LogCategories"), "Category", name=category, description=text)
    experiment = {"startTime": "0.0", "stopTime": "1.0", "stepSize": repr(COMMUNICATION_STEP)}
    experiment |= [("tolerance", repr(x.start)) for x in variables if x.name == TOLERANCE]
    SubElement(root, "DefaultExperiment", experiment)


def _attributes(reference: int, variable: Variable) -> tuple[dict[str, str], dict[str, str]]:
    """Return XML attributes of a variable: its kind and its numbers."""
    about = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.text,
        "causality": variable.causality,
        "variability": "tunable" if variable.causality == "parameter" else "continuous",
    }
    if variable.causality in ("output", "local"):
        with_start = "approx" if variable.is_guess else "exact"
        about["initial"] = "calculated" if variable.start is None else with_start
    elif variable.causality == "parameter":
        about["initial"] = "exact"
    attributes = {
        "start": variable.start,
        "min": variable.minimum,
        "max": variable.maximum,
        "nominal": variable.nominal,
    }
    numbers = {key: repr(float(value)) for key, value in attributes.items() if value is not None}
    return about, {"unit": variable.unit, **numbers}


def _structure(layout: Layout) -> Mapping[str, list[int]]:
    """Return the value references of outputs, of derivatives of states, and of what is computed at first."""
    derivatives = [i for i, x in enumerate(layout.variables) if x.derivative is not None]
    outputs = [i for i, x in enumerate(layout.variables) if x.causality == "output"]
    without_start = {i for i in outputs if layout.variables[i].start is None or layout.variables[i].is_guess}
    unknown = without_start | set(derivatives)
    return {"Outputs": outputs, "Derivatives": derivatives, "InitialUnknowns": sorted(unknown)}


def _dependencies(layout: Layout, reference: int, first: int) -> dict[str, str]:
    """Return states and inputs that a variable depends on, counted from ``first`` on; nothing where it may be all."""
    depends = layout.variables[reference].depends
    return {} if depends is None else {"dependencies": " ".join(str(first + i) for i in depends)}
