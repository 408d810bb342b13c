"""A compiled model of MuJoCo as plain MJCF: no defaults, no copies, no geoms, all numbers with all their digits."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from .values import Array, Item

_JOINTS = ("free", "ball", "slide", "hinge")  # as MuJoCo numbers them
_FLAGS = ("GRAVITY", "SPRING", "DAMPER", "FRICTIONLOSS")
_ROUND_OFF = 1e-14  # of an inertia's greatest entry


def flat_model(model: Any, mujoco: Any, explicit: Collection[int], degrees: Collection[int]) -> Element:
    """Return the root of plain MJCF.

    Args:
        model: an mjModel.
        mujoco: the module, for its names of numbers.
        explicit: ids of bodies whose inertia stands in the file; of the others, those that do not move need none.
        degrees: ids of hinges whose range MuJoCo leaves in degrees, because it is not active.
    """
    name = bytes(model.names).partition(b"\0")[0].decode("utf-8", "replace")  # the model's is the first of all names
    root = Element("mujoco", model=name)
    SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    _option(root, model, mujoco)
    _bodies(SubElement(root, "worldbody"), model, explicit, degrees)
    _tendons(SubElement(root, "tendon"), model, mujoco)
    _equalities(SubElement(root, "equality"), model, mujoco)
    if (model.geom_bodyid > 0).any():
        SubElement(root, "contact")
    if model.nflex:
        SubElement(SubElement(root, "deformable"), "flex")
    if model.nplugin:
        SubElement(SubElement(root, "extension"), "plugin")
    return root


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _set(element: Element, **values: str) -> Element:
    """Set attributes, but for empty ones, and return the element."""
    for key, value in values.items():
        if value:
            element.set(key, value)
    return element


def _nonzero(element: Element, key: str, values: Iterable[float]) -> None:
    """Set an attribute of numbers, without trailing zeros, where one of them is not 0."""
    numbers = [float(value) for value in values]
    while numbers and numbers[-1] == 0.0:
        numbers.pop()
    if numbers:
        element.set(key, _text(numbers))


def _polynomial(model: Any, key: str, index: int) -> list[float]:
    """Return a coefficient, and those of higher powers where this MuJoCo has them."""
    higher = getattr(model, f"{key}poly", None)
    return [getattr(model, key)[index], *(() if higher is None else higher[index])]


def _option(root: Element, model: Any, mujoco: Any) -> None:
    option = SubElement(root, "option", gravity=_text(model.opt.gravity))
    _nonzero(option, "density", [model.opt.density])
    _nonzero(option, "viscosity", [model.opt.viscosity])
    flag = SubElement(option, "flag")
    bits = mujoco.mjtDisableBit
    for name in _FLAGS:
        bit = getattr(bits, f"mjDSBL_{name}", None) or bits.mjDSBL_PASSIVE  # one flag for two, before MuJoCo 3.3.6
        if model.opt.disableflags & int(bit):
            flag.set(name.lower(), "disable")


def _bodies(world: Element, model: Any, explicit: Collection[int], degrees: Collection[int]) -> None:
    """Write bodies in MuJoCo's order, each with its inertia, joints and sites."""
    made, moves = [world], [False]
    for index in range(1, model.nbody):
        parent = int(model.body_parentid[index])
        moves.append(moves[parent] or bool(model.body_jntnum[index]))
        body = SubElement(made[parent], "body", pos=_text(model.body_pos[index]), quat=_text(model.body_quat[index]))
        _set(body, name=model.body(index).name, mocap="true" if model.body_mocapid[index] >= 0 else "")
        _nonzero(body, "gravcomp", [model.body_gravcomp[index]])
        if index in explicit or (moves[index] and model.body_mass[index] > 0.0):
            _inertial(body, model, index)
        made.append(body)
    for index in range(model.njnt):
        _joint(made[model.jnt_bodyid[index]], model, index, math.pi / 180.0 if index in degrees else 1.0)
    for index in range(model.nsite):
        if name := model.site(index).name:
            pose = {"pos": _text(model.site_pos[index]), "quat": _text(model.site_quat[index])}
            SubElement(made[model.site_bodyid[index]], "site", {"name": name, **pose})


def _inertial(body: Element, model: Any, index: int) -> None:
    """Write mass and inertia in the body's axes; round-off becomes 0, which prunes the equations."""
    turn = Item.turned(np.array(model.body_iquat[index]))
    full: Array = turn @ np.diag(model.body_inertia[index]) @ turn.T
    full = np.where(np.abs(full) < _ROUND_OFF * np.abs(full).max(), 0.0, full)
    entries = (full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2])
    inertial = SubElement(body, "inertial", mass=repr(float(model.body_mass[index])))
    _set(inertial, pos=_text(model.body_ipos[index]), fullinertia=_text(entries))


def _joint(body: Element, model: Any, index: int, unit: float) -> None:
    kind, dof, at = _JOINTS[model.jnt_type[index]], model.jnt_dofadr[index], model.jnt_qposadr[index]
    joint = _set(SubElement(body, "joint", type=kind), name=model.joint(index).name)
    _nonzero(joint, "stiffness", _polynomial(model, "jnt_stiffness", index))
    _nonzero(joint, "damping", _polynomial(model, "dof_damping", dof))
    _nonzero(joint, "armature", [model.dof_armature[dof]])
    _nonzero(joint, "frictionloss", [model.dof_frictionloss[dof]])
    _nonzero(joint, "springyield", [_entry(model, "jnt_springyield", index)])
    if kind != "free":
        joint.set("pos", _text(model.jnt_pos[index]))
    if kind in ("hinge", "slide"):
        joint.set("axis", _text(model.jnt_axis[index]))
        _nonzero(joint, "ref", [model.qpos0[at]])
        _nonzero(joint, "springref", [model.qpos_spring[at]])
        if model.jnt_limited[index] or model.jnt_range[index].any():
            joint.set("range", _text(model.jnt_range[index] * unit))
            joint.set("limited", "true" if model.jnt_limited[index] else "false")
        if model.jnt_actfrcrange[index].any():
            joint.set("actuatorfrcrange", _text(model.jnt_actfrcrange[index]))


def _entry(model: Any, key: str, index: int) -> float:
    """Return a number of newer versions of MuJoCo; 0 in others."""
    values = getattr(model, key, None)
    return 0.0 if values is None else float(values[index])


def _tendons(section: Element, model: Any, mujoco: Any) -> None:
    wraps = mujoco.mjtWrap
    for index in range(model.ntendon):
        first = int(model.tendon_adr[index])
        along = range(first, first + int(model.tendon_num[index]))
        fixed = model.wrap_type[first] == wraps.mjWRAP_JOINT
        tendon = _set(SubElement(section, "fixed" if fixed else "spatial"), name=model.tendon(index).name)
        for key in ("stiffness", "damping"):
            _nonzero(tendon, key, _polynomial(model, f"tendon_{key}", index))
        for key in ("frictionloss", "armature", "springyield"):
            _nonzero(tendon, key, [_entry(model, f"tendon_{key}", index)])
        if model.tendon_limited[index]:
            _set(tendon, limited="true", range=_text(model.tendon_range[index]))
        tendon.set("springlength", _text(model.tendon_lengthspring[index]))
        for wrap in along:
            target = int(model.wrap_objid[wrap])
            if model.wrap_type[wrap] == wraps.mjWRAP_SITE:
                SubElement(tendon, "site", site=model.site(target).name)
            elif fixed:
                SubElement(tendon, "joint", joint=model.joint(target).name, coef=repr(float(model.wrap_prm[wrap])))
            else:
                SubElement(tendon, "pulley" if model.wrap_type[wrap] == wraps.mjWRAP_PULLEY else "geom")


def _equalities(section: Element, model: Any, mujoco: Any) -> None:
    for index in range(model.neq):
        kind = mujoco.mjtEq(model.eq_type[index]).name.removeprefix("mjEQ_").lower()
        active = "true" if model.eq_active0[index] else "false"
        equality = _set(SubElement(section, kind, active=active), name=model.equality(index).name)
        data = model.eq_data[index]
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        if kind == "joint":
            _set(equality, joint1=model.joint(first).name, polycoef=_text(data[:5]))
            _set(equality, joint2=model.joint(second).name if second >= 0 else "")
        elif kind in ("connect", "weld"):
            if model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE:
                _set(equality, site1=model.site(first).name, site2=model.site(second).name)
            else:
                _set(equality, body1=model.body(first).name, body2=model.body(second).name, anchor=_text(data[:3]))
                _set(equality, relpose=_text(data[3:10]) if kind == "weld" else "")
