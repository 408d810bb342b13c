"""MJCF in, Draft out: MuJoCo compiles the model, and its numbers become links, joints, springs, couplings and loops.

A body is a link of its name and frame; its joints become joints of up to six coordinates (``mjcf.joints``).  What acts
on the motion and has no equal here is refused; contacts and actuators are left out, with notes, and so are limits where
no stops are asked for.

Source: MuJoCo documentation, XML reference and modeling; mjModel in its API reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eomgen.identifiers import is_robot_name, to_robot_name
from eomgen.names import joint_of, kind_of, listed, show
from eomgen.robot.bounds import Limits
from eomgen.robot.geometry import ZERO

from ..draft import Draft, Place
from .bodies import Bodies
from .compiled import Model, compiled_model, line_with
from .constraints import Constraints
from .copies import refusal
from .poses import triple

VELOCITY = ".limits.velocity"  # behind a coordinate's name: a <numeric> with the limit of its speed


def root_tag(text: str) -> str:
    """Return the name of the first element of an XML text, "" where there is none; nothing is parsed."""
    at = text.find("<")
    while at >= 0:
        if text.startswith("<!--", at):
            at = text.find("-->", at)
        elif text[at + 1 : at + 2] not in ("!", "?"):
            rest = text[at + 1 : at + 80].replace("/", " ").replace(">", " ")
            return (rest.split() or [""])[0]
        at = text.find("<", at + 1) if at >= 0 else -1
    return ""


def draft_from_mjcf(text: str, source: str, path: Path | None = None) -> Draft:
    """Read an MJCF model through MuJoCo.

    Args:
        text: the XML.
        source: the file's name, for messages.
        path: the file, where there is one; a text alone opens no file that it names.

    Raises:
        NotInstalledError: MuJoCo is not installed.
        DescriptionError: anything that MuJoCo does not take, or that acts on the motion and has no equal here; with
            the element and its line.
    """
    model = compiled_model(text, source, None if path is None else path.parent)
    draft = Draft(source, base="world", xml_source=source, notes=list(model.notes))
    draft.name = model.name if is_robot_name(model.name) else to_robot_name(model.name)
    if draft.name != model.name:
        draft.notes.append(f"model {show(model.name)} is called {draft.name} here")
    _read_option(model, draft, text)
    bodies = Bodies(model, draft)
    bodies.read()
    if model.fused:
        draft.notes.append(f"bodies that fusestatic has joined with their parents: {listed(model.fused)}")
    Constraints(bodies).read()
    _read_efforts(bodies)
    _read_velocities(model, draft)
    if (model["geom_bodyid"] > 0).any():
        draft.notes.append("contacts between geoms are left out")
    draft.foreign = set(draft.links)
    whole = line_with("<worldbody", text)

    def places(wheres: Sequence[str]) -> list[Place | None]:
        lines = [bodies.written.get(".".join(where.split(".")[:2]), whole) for where in wheres]
        return [None if line is None else (line, None) for line in lines]

    draft.places = places
    return draft


def _read_option(model: Model, draft: Draft, text: str) -> None:
    for key in ("density", "viscosity"):
        if model.option[key] != 0.0:
            message = f"{key} is {model.option[key]:g}: forces of a fluid are not supported; allowed: 0"
            raise refusal(message, model.source, line_with(f"{key}=", text), "option")
    draft.gravity = ZERO if "mjDSBL_GRAVITY" in model.disabled else triple(model.option["gravity"])


def _read_efforts(bodies: Bodies) -> None:
    """Put force limits of actuators into the draft; of several on one joint their sum, where all have one."""
    model, draft = bodies.model, bodies.draft
    efforts_of: dict[str, list[float | None]] = {}
    uneven: list[str] = []
    named = [name or f"number {index + 1}" for index, name in enumerate(model.names["actuator"])]
    for index, name in enumerate(named):
        joint = int(model["actuator_trnid"][index][0])
        if model.words["actuator_trntype"][index] in ("joint", "jointinparent") and joint in bodies.coordinates:
            effort, even = _effort(model, index)
            efforts_of.setdefault(bodies.coordinates[joint][0], []).append(effort)
            uneven += [] if even else [name]
    for coordinate, efforts in efforts_of.items():
        if None not in efforts:
            owner, kind = draft.joints[joint_of(coordinate)], kind_of(coordinate)
            limits = owner.limits_of(kind).within(Limits(effort=sum(effort or 0.0 for effort in efforts)))
            draft.joints[owner.name] = owner.with_limits(kind, limits)
    if uneven:
        what = "effort is the greater end of a range of forces that is not symmetric"
        draft.notes.append(f"{what}: {listed(uneven)}")
    if named:
        what = "of actuators limits of force are read, not gains, damping and armature (drives are u)"
        draft.notes.append(f"{what}: {listed(named)}")


def _effort(model: Model, index: int) -> tuple[float | None, bool]:
    """Return the greatest force of an actuator, N or N m at its joint, and whether it is that of both directions.

    None: it has no limit.
    """
    words = tuple(model.words[f"actuator_{key}type"][index] for key in ("gain", "bias", "dyn"))
    ranges = []
    if model["actuator_forcelimited"][index]:
        ranges.append(model["actuator_forcerange"][index])
    if words == ("fixed", "none", "none") and model["actuator_ctrllimited"][index]:  # the force is a gain times control
        control = int(model.numbers("actuator_ctrladr", index)[0]) if "actuator_ctrladr" in model.arrays else index
        ranges.append(model["actuator_gainprm"][index][0] * model["actuator_ctrlrange"][control])
    gear = abs(float(model["actuator_gear"][index][0]))
    efforts = [gear * max(map(abs, ends.tolist())) for ends in ranges]
    return min(efforts, default=0.0) or None, all(ends[0] == -ends[1] for ends in ranges)


def _read_velocities(model: Model, draft: Draft) -> None:
    """Put velocity limits into the draft, which MuJoCo knows as numbers without a meaning."""
    for index, text in enumerate(model.names["numeric"]):
        name, ending, rest = text.partition(VELOCITY)
        joint = draft.joints.get(joint_of(name)) if ending and not rest and "." in name else None
        if joint is not None and kind_of(name) in joint.coordinates and model["numeric_size"][index] == 1:
            value = float(model["numeric_data"][int(model["numeric_adr"][index])])
            limits = joint.limits_of(kind_of(name)).within(Limits(velocity=value))
            draft.joints[joint.name] = joint.with_limits(kind_of(name), limits)
