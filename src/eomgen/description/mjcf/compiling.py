"""The process that compiles an MJCF text with MuJoCo, within limits, and writes the compiled model on its output.

What is only shown is replaced before, so that no texture and no visual mesh needs to be there.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import warnings
from collections.abc import Iterator
from typing import Any

from eomgen.limits import MOST_ENTRIES

ARRAYS = (  # of mjModel; those that a version of MuJoCo lacks are left out
    *("body_parentid", "body_pos", "body_quat", "body_mass", "body_ipos", "body_iquat", "body_inertia"),
    *("body_mocapid", "body_gravcomp", "body_jntadr", "body_jntnum", "geom_bodyid"),
    *("jnt_pos", "jnt_axis", "jnt_range", "jnt_limited", "jnt_stiffness", "jnt_stiffnesspoly"),
    *("jnt_springyield", "jnt_actfrcrange", "jnt_qposadr", "jnt_dofadr", "qpos0", "qpos_spring"),
    *("dof_damping", "dof_dampingpoly", "dof_armature", "dof_frictionloss", "site_bodyid", "site_pos", "site_quat"),
    *("tendon_adr", "tendon_num", "tendon_limited", "tendon_length0", "tendon_lengthspring", "tendon_stiffness"),
    *("tendon_stiffnesspoly", "tendon_damping", "tendon_dampingpoly", "tendon_frictionloss", "tendon_armature"),
    *("tendon_springyield", "wrap_objid", "wrap_prm"),
    *("eq_obj1id", "eq_obj2id", "eq_active0", "eq_data"),
    *("actuator_trnid", "actuator_gear", "actuator_gainprm", "actuator_forcelimited", "actuator_forcerange"),
    *("actuator_ctrllimited", "actuator_ctrlrange", "actuator_ctrladr", "numeric_adr", "numeric_size", "numeric_data"),
)
_KINDS = {  # of mjModel's elements: its count of them, and the list of the specification
    "body": ("nbody", "bodies"),
    "joint": ("njnt", "joints"),
    "site": ("nsite", "sites"),
    "tendon": ("ntendon", "tendons"),
    "equality": ("neq", "equalities"),
    "actuator": ("nu", "actuators"),
    "numeric": ("nnumeric", "numerics"),
}
_WORDS = {  # arrays of mjModel that hold numbers of an enumeration
    "jnt_type": "mjtJoint",
    "wrap_type": "mjtWrap",
    "eq_type": "mjtEq",
    "eq_objtype": "mjtObj",
    "actuator_trntype": "mjtTrn",
    "actuator_gaintype": "mjtGain",
    "actuator_biastype": "mjtBias",
    "actuator_dyntype": "mjtDyn",
}
_MOST_NUMBERS = 20 * MOST_ENTRIES  # of points that tendons go along, and of custom numbers


class _RefusalError(Exception):
    """The model has what is not supported, in a line of its text."""


def main(folder: str, seconds: str, gibibytes: str) -> None:
    """Compile the text on the standard input and write the answer, a JSON object, to the standard output.

    Args:
        folder: where files that the model names are looked for; empty: it may open none.
        seconds: limit of processor time.
        gibibytes: limit of address space.

    ``version``, ``warnings`` and ``model``; or ``said``, why MuJoCo does not take the text, or ``refused``, why it is
    not read.
    """
    text = sys.stdin.buffer.read().decode()
    with os.fdopen(os.dup(1), "w") as output:
        os.dup2(2, 1)  # so that MuJoCo prints nothing into the answer
        _limit(CPU=int(seconds), AS=int(gibibytes) << 30, CORE=0)
        output.write(json.dumps(_answer(text, folder)))


def _limit(**limits: int) -> None:
    """Limit what this process may take, where the system can; CPU: s, AS: bytes of memory, NOFILE: files."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for name, most in limits.items():
        with contextlib.suppress(OSError, ValueError):  # a lower one is there already, or the system has none
            resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (most, most))


def _answer(text: str, folder: str) -> dict[str, Any]:
    try:
        import mujoco
    except ImportError as error:  # it is installed, and broken
        return {"said": f"it cannot be imported ({error})"}
    if folder:
        os.chdir(folder)
    else:
        _limit(NOFILE=0)
    heard: list[str] = []
    mujoco.set_mju_user_warning(heard.append)
    if hasattr(mujoco, "MjLogConfig"):
        config = mujoco.MjLogConfig.get()
        config.logto_file = False  # MUJOCO_LOG.TXT, in the folder of the model
        config.set()
    answer: dict[str, Any] = {"version": mujoco.__version__}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            answer["model"] = _compiled(text, mujoco)
        except _RefusalError as error:
            answer["refused"] = str(error)
        except MemoryError:
            answer["said"] = "there is not enough memory"
        except (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError) as error:  # as its binding does
            answer["said"] = str(error)
    answer["warnings"] = [*heard, *(str(each.message) for each in caught)]
    return answer


def _compiled(text: str, mujoco: Any) -> dict[str, Any]:
    """Return what ``compiled.Model`` holds of a text, in types of JSON."""
    spec = mujoco.MjSpec.from_string(text)
    _refuse_many({key: len(getattr(spec, key)) for _, key in _KINDS.values()}, MOST_ENTRIES)
    for item in spec.flexes:
        raise _RefusalError(f"deformable bodies are not supported ({item.info}); allowed: a model without <flex>")
    _replace_visuals(spec, mujoco)
    spec.compiler.LRopt.mode = mujoco.mjtLRMode.mjLRMODE_NONE  # of muscles, found by simulations
    before = {body.name for body in spec.bodies}
    model = spec.compile()
    if model.nplugin:
        raise _RefusalError("plugins are not supported; allowed: a model without <plugin>")
    _refuse_many({"points of tendons": model.nwrap, "numbers of <numeric>": model.nnumericdata}, _MOST_NUMBERS)
    flags = mujoco.mjtDisableBit.__members__
    found: dict[str, Any] = {"name": bytes(model.names).partition(b"\0")[0].decode()}
    found["words"] = {key: _words(getattr(model, key), getattr(mujoco, kind)) for key, kind in _WORDS.items()}
    found["arrays"] = {key: getattr(model, key).tolist() for key in ARRAYS if hasattr(model, key)}
    option = {"gravity": model.opt.gravity.tolist(), "density": model.opt.density, "viscosity": model.opt.viscosity}
    found["option"] = option
    found["disabled"] = [name for name, bit in flags.items() if model.opt.disableflags & int(bit)]
    found["names"] = {kind: _names(model, kind, size) for kind, (size, _) in _KINDS.items()}
    found["lines"] = {kind: {item.id: item.info for item in getattr(spec, key)} for kind, (_, key) in _KINDS.items()}
    found["explicit"] = [body.id for body in spec.bodies if body.explicitinertial]
    found |= _changed(spec, model, mujoco)
    found["fused"] = sorted(before - set(found["names"]["body"]))
    return found


def _words(numbers: Any, kind: Any) -> list[str]:
    """Return the members of an enumeration of these numbers, as "hinge" of mjJNT_HINGE."""
    names = {int(value): name.partition("_")[2].lower() for name, value in kind.__members__.items()}
    return [names[int(number)] for number in numbers]


def _names(model: Any, kind: str, size: str) -> list[str]:
    return [getattr(model, kind)(index).name for index in range(getattr(model, size))]


def _refuse_many(counts: dict[str, int], most: int) -> None:
    """Refuse more entries than a description may hold."""
    for what, count in counts.items():
        if count > most:
            raise _RefusalError(f"the model has {count} {what}; allowed: up to {most}")


def _changed(spec: Any, model: Any, mujoco: Any) -> dict[str, list[int]]:
    """Return hinges whose range stays in degrees, as it is not active, and bodies that move to their centres of mass.

    These have a free joint, and no bodies on them.
    """
    found: dict[str, list[int]] = {"degrees": [], "aligned": []}
    always, never = mujoco.mjtAlignFree.mjALIGNFREE_TRUE, mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            found["degrees"] += [joint.id] * bool(joint.compiler.degree and not model.jnt_limited[joint.id])
        elif joint.type == mujoco.mjtJoint.mjJNT_FREE and not joint.parent.bodies:
            wanted = joint.align == always or (joint.align != never and joint.compiler.alignfree)
            found["aligned"] += [joint.parent.id] * bool(wanted)
    return found


def _replace_visuals(spec: Any, mujoco: Any) -> None:
    """Replace meshes, height fields and textures without effect on masses; deletion takes a time for each."""
    for geom in _visual_geoms(spec):
        geom.type, geom.size, geom.mass = mujoco.mjtGeom.mjGEOM_SPHERE, [0.01, 0.0, 0.0], 0.0
        geom.fromto = [math.nan] * 6
        geom.meshname = geom.hfieldname = ""
    used = {geom.meshname for geom in spec.geoms}
    for mesh in spec.meshes:
        if mesh.name not in used:
            mesh.file, mesh.content_type, mesh.uservert = "", "", [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1]
    for field in spec.hfields:
        field.file, field.content_type, field.nrow, field.ncol, field.userdata = "", "", 2, 2, [0.0] * 4
    for texture in spec.textures:
        texture.file, texture.content_type, texture.cubefiles = "", "", [""] * 6
        texture.builtin, texture.width, texture.height = mujoco.mjtBuiltin.mjBUILTIN_FLAT, 1, 1
    for sensor in spec.sensors:
        sensor.type, sensor.objname, sensor.refname = mujoco.mjtSensor.mjSENS_CLOCK, "", ""
        sensor.objtype = sensor.reftype = mujoco.mjtObj.mjOBJ_UNKNOWN
    for skin in list(spec.skins):
        spec.delete(skin)


def _visual_geoms(spec: Any) -> Iterator[Any]:
    """Yield geoms with a mesh or height field whose mass does not count: their body has one, or does not move."""
    stack = [(spec.worldbody, False)]
    while stack:
        body, carried = stack.pop()
        moves = carried or bool(body.joints)
        stack += [(child, moves) for child in body.bodies]
        for geom in body.geoms:
            if (geom.meshname or geom.hfieldname) and not (moves and _counts(geom, body)):
                yield geom


def _counts(geom: Any, body: Any) -> bool:
    """Return whether a geom of a body that moves gives it a mass."""
    rule, (first, last) = body.compiler.inertiafromgeom, body.compiler.inertiagrouprange
    wanted = {0: False, 1: True}.get(int(rule), not body.explicitinertial)  # 2: where the body has no inertia
    heavy = geom.density > 0.0 if math.isnan(geom.mass) else geom.mass > 0.0
    return bool(wanted and heavy and first <= geom.group <= last)
