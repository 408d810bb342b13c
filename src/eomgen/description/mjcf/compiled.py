"""MJCF through MuJoCo's own compiler, for what the reader here leaves to it: includes, copies, inertias of meshes.

What does not count for the motion is taken out before: no texture, and no mesh that is only shown, needs to be there.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from eomgen.errors import DescriptionError
from eomgen.limits import MOST_ENTRIES
from eomgen.optional import NotInstalledError, optional_import

from ..xml_text import one_line
from .flat import flat_model

_ALLOWED = "a model that MuJoCo compiles, with all files that it names"
_UNUSED = ("sensors", "keys", "pairs", "excludes", "numerics", "texts", "tuples", "skins", "cameras", "lights")
_SHOWN = ("materials", "textures")
_COPIES = ("replicate", "composite")


def compiled_model(path: Path, refusal: DescriptionError, root: Element) -> tuple[Element, str]:
    """The model as MuJoCo compiles it, written out as plain MJCF: bodies with their inertias, joints, sites.

    Args:
        path: the file.
        refusal: what the reader here has said of it.
        root: the file's own elements.

    Returns:
        The root element, and the version of MuJoCo.

    Raises:
        DescriptionError: MuJoCo is not installed, or does not take the file either; says what MuJoCo says.
    """
    try:
        with optional_import("MuJoCo", "it is read through"):
            import mujoco
    except NotInstalledError as missing:
        raise DescriptionError(f"{refusal.message}; or {missing}", where=refusal.where, source=refusal.source) from None
    _refuse_many_copies(root, refusal.source)
    with warnings.catch_warnings():  # MuJoCo's advice to those who write models
        warnings.simplefilter("ignore")
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            drives = _without_what_does_not_count(spec, mujoco)
            model = spec.compile()
        except (ValueError, TypeError, RuntimeError, mujoco.FatalError) as error:
            text = f"MuJoCo {mujoco.__version__}, which is to compile the file, says: {one_line(error)}"
            raise DescriptionError(f"{text}; allowed: {_ALLOWED}", where=refusal.where, source=refusal.source) from None
    given = {body.id for body in spec.bodies if body.explicitinertial}
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    turning = [joint for joint in spec.joints if joint.type == hinge and joint.compiler.degree]
    degrees = {joint.id for joint in turning if not model.jnt_limited[joint.id]}
    flat = flat_model(model, mujoco, given, degrees)
    actuators = SubElement(flat, "actuator")
    for tag, values in drives:
        SubElement(actuators, tag, values)
    return flat, mujoco.__version__


def _refuse_many_copies(root: Element, source: str) -> None:
    """Refuse copies of copies that nobody could derive, before anybody makes them."""
    stack = [(root, 1)]
    while stack:
        element, copies = stack.pop()
        if element.tag in _COPIES:
            for part in element.get("count", "1").split():
                copies *= int(part) if part.isdecimal() and len(part) < 10 else 1
            if copies > MOST_ENTRIES:
                message = f"its bodies are copied {copies} times; allowed: up to {MOST_ENTRIES}"
                raise DescriptionError(message, where=f"<{element.tag}>", source=source)
        stack += [(child, copies) for child in element]


def _actuator(item: Any, mujoco: Any) -> tuple[str, dict[str, str]]:
    """Tag and attributes of an actuator: its name, its joint and the limits of its force."""
    values = {"name": item.name or "<actuator>"}
    if item.trntype in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        values |= {"joint": item.target, "gear": repr(float(item.gear[0]))}
    ranges = {"force": item.forcerange}
    gain, bias, activation = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtDyn.mjDYN_NONE
    is_motor = (item.gaintype, item.biastype, item.dyntype) == (gain, bias, activation)
    if is_motor:
        ranges["ctrl"] = sorted(float(item.gainprm[0]) * item.ctrlrange)
    for kind, ends in ranges.items():
        if any(ends) and getattr(item, f"{kind}limited") != mujoco.mjtLimited.mjLIMITED_FALSE:
            values[f"{kind}range"] = " ".join(repr(float(x)) for x in ends)
    return ("motor" if is_motor else "general"), values


def _without_what_does_not_count(spec: Any, mujoco: Any) -> list[tuple[str, dict[str, str]]]:
    """Take what has no effect on masses and joints out of the specification; returns its actuators."""
    drives = [_actuator(item, mujoco) for item in spec.actuators]
    for kind in ("actuators", *_UNUSED):
        for item in list(getattr(spec, kind)):
            spec.delete(item)
    for item in _only_shown(spec, mujoco):
        spec.delete(item)
    _drop_unused(spec)
    return drives


def _only_shown(spec: Any, mujoco: Any) -> list[Any]:
    """Geoms of meshes and height fields whose mass does not count: their body's is given, or it does not move."""
    shapes = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    found = []
    for body, moves in _with_motion(spec.worldbody):
        counts = moves and (body.compiler.inertiafromgeom == always or not body.explicitinertial)
        if not counts:
            found += [geom for geom in body.geoms if geom.type in shapes]
    return found


def _with_motion(world: Any) -> list[tuple[Any, bool]]:
    """All bodies, each with whether it moves."""
    found, stack = [], [(world, False)]
    while stack:
        body, carried = stack.pop()
        moves = carried or bool(body.joints)
        found.append((body, moves))
        stack += [(child, moves) for child in body.bodies]
    return found


def _drop_unused(spec: Any) -> None:
    """Take out files that nothing names any more: looks, meshes, height fields."""
    for geom in spec.geoms:
        geom.material = ""
    for site in spec.sites:
        site.material = ""
    for tendon in spec.tendons:
        tendon.material = ""
    for kind in _SHOWN:
        for item in list(getattr(spec, kind)):
            spec.delete(item)
    meshes, fields = ({getattr(geom, key) for geom in spec.geoms} for key in ("meshname", "hfieldname"))
    unused: Mapping[str, set[str]] = {"meshes": meshes, "hfields": fields}
    for kind, used in unused.items():
        for item in list(getattr(spec, kind)):
            if item.name not in used:
                spec.delete(item)
