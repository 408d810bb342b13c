"""The process that compiles a foreign MJCF with MuJoCo, within limits, and writes an answer on its output.

Elements without effect on the motion are removed before: no texture, and no visual mesh, needs to be there.
"""

from __future__ import annotations

import contextlib
import json
import os
import warnings
from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from eomgen.limits import MOST_ENTRIES

from ..xml_text import one_line
from .flat import flat_model

_UNUSED = ("sensors", "keys", "pairs", "excludes", "numerics", "texts", "tuples", "skins", "cameras", "lights")
_SHOWN = ("materials", "textures")
_COUNTED = {"nbody": "bodies", "njnt": "joints", "nsite": "sites", "ntendon": "tendons", "neq": "equalities"}
_MOST_WRAPS = 20 * MOST_ENTRIES  # what tendons go along, together


def main(path: str, seconds: str, gibibytes: str) -> None:
    """Compile a file and write the answer, a JSON object, to the standard output.

    ``rows`` (index of the parent, tag, attributes of each element of plain MJCF), ``version`` and ``warnings``; or
    ``said``, why MuJoCo does not take the file.
    """
    with os.fdopen(os.dup(1), "w") as output:
        os.dup2(2, 1)  # so that MuJoCo prints nothing into the answer
        _limit(int(seconds), int(gibibytes) << 30)
        output.write(json.dumps(_answer(path)))


def _limit(seconds: int, size: int) -> None:
    """Limit this process, where the system can: processor time, memory, and files, which it has no need to write."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for kind, most in ((resource.RLIMIT_CPU, seconds), (resource.RLIMIT_AS, size), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(OSError, ValueError):  # a lower one is there already, or the system has none
            resource.setrlimit(kind, (most, most))


def _answer(path: str) -> dict[str, Any]:
    try:
        import mujoco
    except Exception as error:  # it is installed, and broken
        return {"said": f"it cannot be imported ({one_line(error)})"}
    heard: list[str] = []
    mujoco.set_mju_user_warning(heard.append)  # the default writes MUJOCO_LOG.TXT
    answer: dict[str, Any] = {"version": mujoco.__version__}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            answer["rows"] = _rows(_flat(path, mujoco))
        except MemoryError:
            answer["said"] = "there is not enough memory"
        except Exception as error:  # whatever its binding raises
            answer["said"] = one_line(error)
    answer["warnings"] = [one_line(text) for text in (*heard, *(each.message for each in caught))]
    return answer


def _flat(path: str, mujoco: Any) -> Element:
    """Return the root of plain MJCF of a file."""
    spec = mujoco.MjSpec.from_file(path)
    drives = _without_what_does_not_count(spec, mujoco)
    model = spec.compile()
    _refuse_many(model)
    explicit = {body.id for body in spec.bodies if body.explicitinertial}
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    turning = [joint for joint in spec.joints if joint.type == hinge and joint.compiler.degree]
    degrees = {joint.id for joint in turning if not model.jnt_limited[joint.id]}
    flat = flat_model(model, mujoco, explicit, degrees)
    actuators = SubElement(flat, "actuator")
    for tag, values in drives:
        SubElement(actuators, tag, values)
    return flat


def _refuse_many(model: Any) -> None:
    """Refuse more entries than a description may hold, before they are written out."""
    for key, what in _COUNTED.items():
        if (count := int(getattr(model, key))) > MOST_ENTRIES:
            raise ValueError(f"the model has {count} {what} (up to {MOST_ENTRIES} are read)")
    if model.nwrap > _MOST_WRAPS:
        raise ValueError(f"tendons go along {model.nwrap} points (up to {_MOST_WRAPS} are read)")


def _rows(root: Element) -> list[tuple[int, str, dict[str, str]]]:
    """Return each element with the index of its parent, parents first and children in their order."""
    rows, stack = list[tuple[int, str, dict[str, str]]](), [(-1, root)]
    while stack:
        parent, element = stack.pop()
        stack += [(len(rows), child) for child in reversed(element)]
        rows.append((parent, element.tag, element.attrib))
    return rows


def _actuator(item: Any, mujoco: Any) -> tuple[str, dict[str, str]]:
    """Return tag and attributes of an actuator: its name, its joint and its force limits."""
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
    """Remove elements without effect on masses and joints from the specification; return its actuators."""
    drives = [_actuator(item, mujoco) for item in spec.actuators]
    for kind in ("actuators", *_UNUSED):
        for item in list(getattr(spec, kind)):
            spec.delete(item)
    for item in _only_shown(spec, mujoco):
        spec.delete(item)
    _drop_unused(spec)
    return drives


def _only_shown(spec: Any, mujoco: Any) -> list[Any]:
    """Return geoms of meshes and height fields whose mass does not count: their body has one, or does not move."""
    shapes = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    shown = []
    for body, moves in _with_motion(spec.worldbody):
        counts = moves and (body.compiler.inertiafromgeom == always or not body.explicitinertial)
        if not counts:
            shown += [geom for geom in body.geoms if geom.type in shapes]
    return shown


def _with_motion(world: Any) -> list[tuple[Any, bool]]:
    """Return all bodies, each with whether it moves."""
    bodies, stack = [], [(world, False)]
    while stack:
        body, carried = stack.pop()
        moves = carried or bool(body.joints)
        bodies.append((body, moves))
        stack += [(child, moves) for child in body.bodies]
    return bodies


def _drop_unused(spec: Any) -> None:
    """Remove files that nothing names any more: looks, meshes, height fields."""
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
