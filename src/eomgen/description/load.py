"""A robot description in, a validated, immutable Robot out.

    source -> text -> Draft (TOML, URDF, a URDF refined by TOML, or MJCF) -> inertia policy -> tree order -> Robot

TOML syntax and keys: docs and the built-in robots in ``robots/``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

from ..errors import DescriptionError, InputError
from ..forms.keys import ByName
from ..forms.tables import Table
from ..forms.toml_place import located
from ..forms.toml_text import parse_toml, read_text
from ..identifiers import check_kind, show_path
from ..names import listed, nearest, show
from ..robot.bounds import Limits, limits_conflict
from ..robot.elements import KINDS, Element, Spring
from ..robot.geometry import ZERO
from ..robot.inertia_policy import POLICIES, Judged, apply_inertia_policy, link_sizes
from ..robot.internal_states.bristles import active_above
from ..robot.joint_types import OWN_COORDINATES
from ..robot.mechanism import mechanism_conflict
from ..robot.parameter_names import expand_tunable
from ..robot.rules import motor_conflict, unmoved
from ..robot.value import (
    BASE,
    COORDINATES,
    INERTIA_KEYS,
    LINEAR,
    MOTOR,
    PRINCIPAL,
    Coordinate,
    Frame,
    Joint,
    Link,
    Motor,
    Placement,
    Robot,
)
from .bending.beams import add_beam, check_beam_ends
from .bending.links import add_nodes, bending_link, check_body, check_carriers, on_node, on_nodes
from .bending.sliding import add_sliding, on_beam
from .builtin import BUILTIN, builtin_robots
from .draft import Draft, ordered_joints
from .floating import float_base
from .forces import joint_elements, read_coordinate, read_element, read_motor, read_placement
from .keys import ROBOT
from .loops import read_coupling, read_loop, read_offset
from .macros import Xacro
from .options import ReadKeywords, ReadOptions
from .stops import joint_stops, requested_stops, stop_all, stop_numbers

RobotLike = Robot | str | Path  # what functions take where they ask for a robot, see as_robot
SUFFIXES = (".toml", ".urdf", ".xml", ".mjcf", ".xacro")

_WORLD = (BASE, "world")  # names of the ground when the root link of a URDF is put on a joint


def load_robot(  # noqa: PLR0913
    source: str | Path,
    *,
    inertia: str | None = None,
    urdf_damping: bool = False,
    urdf_friction: bool = False,
    urdf_mimic: bool = True,
    stops: Mapping[str, float] | None = None,
    floating_base: bool = False,
    xacro: Xacro = False,
    xacro_args: Mapping[str, object] | None = None,
) -> Robot:
    """Read a robot.

    Args:
        source: name of a built-in robot, or path of a ``.toml``, ``.urdf``, ``.xacro`` or ``.xml`` file.  ``.xml``:
            MJCF or URDF, whatever its root element says.  MJCF goes through MuJoCo, and ``.xacro`` through xacro,
            where ``xacro`` asks for it.
        inertia: what to do with a link whose inertia no body can have: "error", "warn" (take it as it is) or "project"
            (take the nearest possible body).  None: the description's policy, or "error" for an inertia in TOML and
            "warn" for one of a URDF; MuJoCo refuses such inertias in MJCF.
        urdf_damping: read ``<dynamics damping>`` of a URDF; otherwise a note says that it is left out.
        urdf_friction: the same for ``<dynamics friction>``, as Coulomb friction.
        urdf_mimic: make couplings of ``<mimic>``; otherwise a note says that its joints are independent.
        stops: stiffness, damping, restitution_damping, smoothing (the first is needed) of stops at all limits whose
            coordinates have none yet; N/m and so on at translations, N m/rad and so on at rotations.  In the place of
            ``stops`` at the top of a TOML file.
        floating_base: put a free joint, ``floating_base``, between the ground and the root link of a URDF.
        xacro: expand a ``.xacro`` file, which may run any Python that stands in it; otherwise it is refused.  Folders
            of packages by their names, for ``$(find NAME)``, ask for it, too.
        xacro_args: values of the arguments of a ``.xacro`` file by their names: {"ur_type": "ur5e"}.

    Returns:
        The robot in SI units; ``notes`` says what was changed or left out.

    Raises:
        DescriptionError: with the file, the place, what came and what is allowed.
        NotInstalledError: of MJCF, MuJoCo is not installed.
    """
    options = ReadOptions(inertia, urdf_damping, urdf_friction, urdf_mimic, stops, floating_base, xacro, xacro_args)
    check_kind("xacro_args", xacro_args, xacro_args is None or isinstance(xacro_args, Mapping), "values by names")
    if xacro_args and not str(source).endswith(".xacro"):
        message = f"xacro_args: {listed(xacro_args)} of {show_path(str(source))}; allowed: with a .xacro file"
        raise DescriptionError(message)
    if isinstance(source, str) and source in builtin_robots():
        text = read_text(BUILTIN / f"{source}.toml", source)
        return _from_toml(text, options, source)
    if not isinstance(source, (str, Path)):
        raise DescriptionError(f"robot: got a value of type {type(source).__name__}; allowed: a name or a path")
    return _from_file(Path(source), options)


def _from_file(path: Path, options: ReadOptions) -> Robot:
    """Read a file by its ending."""
    if path.suffix == ".sdf":
        from .urdf import SDF

        raise DescriptionError(SDF, source=str(path))
    if path.suffix not in SUFFIXES:
        known, name = builtin_robots(), str(path)
        allowed = f"a path that ends in {', '.join(SUFFIXES)}, or one of {', '.join(known)}"
        raise DescriptionError(f"there is no robot {show_path(name)}{nearest(name, known)} (allowed: {allowed})")
    text = read_text(path, str(path))
    if path.suffix in (".xml", ".mjcf"):
        from .mjcf.read import root_tag  # only who has such a file pays for the XML parser

        if path.suffix == ".mjcf" or root_tag(text) != "robot":
            return _from_mjcf(text, options, str(path), path)
    if path.suffix == ".xacro":
        from .macros import expanded_urdf

        text = expanded_urdf(path, trusted=options.xacro, arguments=options.xacro_args)
    if path.suffix != ".toml":
        return _from_urdf(text, options, f"{path} (expanded)" if path.suffix == ".xacro" else str(path))
    return _from_toml(text, options, str(path), path.parent)


def as_robot(given: RobotLike) -> Robot:
    """Return the robot itself, or the one that ``load_robot`` reads under a built-in name or path.

    Raises:
        InputError: it is none of these; says what came and what is allowed.
        DescriptionError: nothing is there under that name or path, or what is there is wrong.
    """
    if isinstance(given, Robot):
        return given
    if not isinstance(given, (str, Path)):
        raise InputError(
            f"robot: got a value of type {type(given).__name__}; allowed: a Robot (from load_robot), the name of a"
            f" built-in one ({', '.join(builtin_robots())}), or the path of a description ({', '.join(SUFFIXES)})"
        )
    return load_robot(given)


def robot_from_urdf(text: str, *, source: str = "", **options: Unpack[ReadKeywords]) -> Robot:
    """Return the robot of a URDF text; options and errors as load_robot."""
    return _from_urdf(text, ReadOptions(**options), source)


def _from_urdf(text: str, options: ReadOptions, source: str) -> Robot:
    from .urdf import draft_from_urdf  # only who has a URDF pays for the XML parser

    return _finish_xml(draft_from_urdf(text, source, **_of_urdf(options)), options)


def _of_urdf(options: ReadOptions) -> dict[str, bool]:
    return {"damping": options.urdf_damping, "friction": options.urdf_friction, "mimic": options.urdf_mimic}


def robot_from_mjcf(text: str, *, source: str = "", path: Path | None = None, **options: Unpack[ReadKeywords]) -> Robot:
    """Return the robot of an MJCF text; options and errors as load_robot.

    Files that it names are looked for in the folder of ``path``; a text alone opens no file.
    """
    return _from_mjcf(text, ReadOptions(**options), source, path)


def _from_mjcf(text: str, options: ReadOptions, source: str, path: Path | None) -> Robot:
    from .mjcf.read import draft_from_mjcf

    return _finish_xml(draft_from_mjcf(text, source, path), options)


def _finish_xml(draft: Draft, options: ReadOptions) -> Robot:
    _equip(draft, None if options.stops is None else requested_stops(options.stops), options.floating_base)
    try:
        return _finish(draft, options.inertia, [])
    except DescriptionError as error:
        error.line, error.column = draft.places([error.where])[0] or (None, None)
        raise


def robot_from_toml(
    text: str, *, source: str = "", folder: Path | None = None, **options: Unpack[ReadKeywords]
) -> Robot:
    """Return the robot of a TOML text.

    Args:
        text: of the description.
        source: its name, for messages.
        folder: where its ``urdf`` is looked for.
        **options: inertia, urdf_damping, urdf_friction, urdf_mimic, stops and floating_base, see ``load_robot``.

    Raises:
        DescriptionError: as of ``load_robot``.
    """
    return _from_toml(text, ReadOptions(**options), source, folder)


def _from_toml(text: str, options: ReadOptions, source: str, folder: Path | None = None) -> Robot:
    values = parse_toml(text, source)
    with located(text, values, source):
        top = ROBOT.read(values, "", source, ())
        return _robot_from_table(top, _start(top, source, folder, options), folder, options)


def _robot_from_table(top: Table, draft: Draft, folder: Path | None, options: ReadOptions) -> Robot:
    draft.gravity = top.vector("gravity") or draft.gravity
    for name, entry in top.entries("links"):
        draft.links[name] = _link(name, entry, draft, folder)
    for name, entry in top.entries("joints"):
        draft.joints[name] = read_joint(name, entry, draft, folder)
    for name, entry in top.entries("beams"):
        add_beam(name, entry, draft)
    for name, entry in top.entries("frames"):
        draft.frames[name] = _frame(name, entry, draft)
    for name, entry in top.entries("loops"):
        loop = read_loop(name, entry, lambda table: _beside(table, folder), folder, draft.notes)
        draft.loops[name] = replace(loop, links=on_nodes(entry, loop.links, draft))
    for name, entry in top.entries("couplings"):
        draft.couplings[name] = read_coupling(name, entry, _beside(entry, folder), draft.notes)
    for key in KINDS:
        for name, entry in top.entries(key):
            if name in draft.elements:
                earlier = draft.elements[name].TABLE
                entry.fail(f"the name {name!r} is taken by an earlier entry of [[{earlier}]]; allowed: unique names")
            element = read_element(key, name, entry, _beside(entry, folder), folder)
            draft.elements[name] = replace(element, links=on_nodes(entry, element.links, draft))
    add_nodes(draft)
    add_sliding(draft)
    draft.driven = tuple(top.strings("driven")) if "driven" in top else draft.driven
    draft.home = top.value("home", ByName) or draft.home
    _resolve_base(draft)
    check_beam_ends(draft)
    check_carriers(draft)
    table = top.table("stops")
    said = None if table is None else stop_numbers(table)
    _equip(draft, said if options.stops is None else requested_stops(options.stops), options.floating_base)
    try:
        return _finish(draft, options.inertia or top.choice("inertia"), top.strings("tunable"))
    except DescriptionError as error:
        if draft.xml_source and not error.path and not _says(top, error.where):
            error.source = draft.xml_source
            error.line, error.column = draft.places([error.where])[0] or (None, None)
        raise


def _equip(draft: Draft, stops: Mapping[str, float] | None, floating_base: bool) -> None:
    """Add the options beside the description: stops at limits, numbers as of ``stop_numbers``; a floating base."""
    if stops is not None:
        stop_all(draft, stops)
    elif draft.unstopped:
        draft.notes.append(f"nothing stops at the limits of joints: {listed(draft.unstopped)} (stops=... does)")
    if floating_base:
        float_base(draft)


def _says(top: Table, where: str) -> bool:
    """Return whether the TOML itself has the place of a message about the whole robot, as in joints.NAME.child."""
    kind, _, rest = where.partition(".")
    if kind not in ("links", "joints") or not rest:
        return kind in top
    return any(entry.get("name") == rest.partition(".")[0] for entry in top.values.get(kind, []))


def _start(top: Table, source: str, folder: Path | None, options: ReadOptions) -> Draft:
    """Return the draft to fill: that of the URDF, or an empty one; with its name."""
    draft = Draft(source)
    urdf = top.text("urdf")
    if urdf is not None:
        if folder is None:
            top.fail(f"got {show(urdf)}; allowed: the path of a .urdf file, relative to this file", "urdf")
        from .urdf import draft_from_urdf

        path = folder / urdf
        text = read_text(path, str(path))
        draft = draft_from_urdf(text, str(path), **_of_urdf(options))
        draft.source = source
        draft.inherited = (*draft.links, *draft.joints)
    else:
        top.require()
    draft.name = top.text("name") or draft.name
    return draft


def _hint(name: str, draft: Draft) -> str:
    """Return a hint that a new entry was perhaps meant to refine one of the URDF."""
    return f" (the URDF has no {name!r}{nearest(name, draft.inherited)})" if draft.inherited else ""


def _link(name: str, entry: Table, draft: Draft, folder: Path | None) -> Link:
    """Return a new link, or one of the URDF with the entry's overrides."""
    old = draft.links.get(name)
    if old is None:
        if name == BASE:
            entry.fail("the name 'base' is that of the ground; allowed: another name", "name")
        entry.require(_hint(name, draft))
    bends = bending_link(name, entry, folder, draft)
    if bends is not None:
        check_body(entry, bends)
        draft.foreign.discard(name)
        return bends
    if old is None and "mass" not in entry:
        entry.fail(f"the key 'mass' is missing; allowed: a mass in kg, or beam or modes{_hint(name, draft)}")
    mass, com = entry.number("mass"), entry.vector("com")
    table = entry.table("inertia")
    inertia = None
    if table is not None:
        xx, yy, zz, xy, xz, yz = (table.number(key) or 0.0 for key in INERTIA_KEYS)
        inertia = xx, yy, zz, xy, xz, yz
        draft.foreign.discard(name)
    start = old or Link(name, 0.0, ZERO, (0.0,) * 6)
    return Link(
        name,
        start.mass if mass is None else mass,
        start.com if com is None else com,
        start.inertia if inertia is None else inertia,
    )


def read_joint(name: str, entry: Table, draft: Draft, folder: Path | None) -> Joint:
    """Return a new joint, or one of the draft with the entry's overrides and the coordinates that it activates."""
    old = draft.joints.get(name)
    if old is None:
        entry.require(_hint(name, draft))
        old = Joint(name, "", "", "fixed")
    parent, child = entry.text("parent") or old.parent, entry.text("child") or old.child
    parent = on_node(entry, "node", parent, entry.text("node"), draft)
    kind = entry.choice("type") or old.type
    coordinates = dict(old.coordinates) if kind == old.type else {}
    for key in OWN_COORDINATES[kind]:
        coordinates.setdefault(key, Coordinate())
    for key in COORDINATES:
        table = entry.table(key)
        if table is not None:
            old_one = coordinates.get(key, Coordinate())
            coordinates[key] = read_coordinate(table, old_one, _beside(table, folder), draft.notes)
            if table.text("role") == "locked":
                del coordinates[key]
    motor = _motor(entry, kind, coordinates, folder, draft.notes) or old.motor
    for key in dict.fromkeys(entry.strings("prescribed")):
        known = COORDINATES if motor is None else (*COORDINATES, MOTOR)
        if key not in known:
            entry.fail(f"got {show(key)}{nearest(key, known)}; allowed: {', '.join(known)}", "prescribed")
        if key in entry and entry.values[key].get("role", "prescribed") != "prescribed":
            entry.fail(f"{key} is prescribed here and {entry.values[key]['role']} in its table", "prescribed")
        if motor is not None and key == MOTOR:
            motor = replace(motor, prescribed=True)
        else:
            coordinates[key] = replace(coordinates.get(key, Coordinate()), prescribed=True)
    placement, offset = _placement(entry, old.placement), read_offset(entry, old.offset)
    turn = old.axis_turn
    made = _range(entry, Joint(name, parent, child, kind, placement, turn, coordinates, None, offset, motor), old)
    coordinates = dict(made.coordinates)
    if "stops" in entry:
        coordinates[made.principal] = joint_stops(entry, kind, coordinates, made.range)
    elements = old.elements | joint_elements(entry, coordinates, folder, draft.notes)
    pitch = entry.number("pitch") if "pitch" in entry else old.pitch if kind == old.type else None
    made = replace(made, coordinates=coordinates, pitch=pitch, **elements)
    return on_beam(entry, made, draft) if entry.choice("along") else made


def _motor(
    entry: Table, kind: str, coordinates: dict[str, Coordinate], folder: Path | None, notes: list[str]
) -> Motor | None:
    """Return the motor behind the joint's principal coordinate."""
    table = entry.table(MOTOR)
    if table is None:
        return None
    motor = read_motor(table, _beside(table, folder), notes)
    conflict = motor_conflict(motor, kind, coordinates)
    if conflict is not None:
        table.fail(conflict[1], conflict[0])
    return motor


def _beside(table: Table, folder: Path | None) -> Callable[[str], str]:
    """Return a reader of the CSV file of a curve, which stands beside the description."""

    def read(name: str) -> str:
        if folder is None:
            table.fail(f"got {show(name)}; allowed: the path of a .csv file, relative to this file", "curve")
        return read_text(folder / name, str(folder / name), "file of deviation,force lines")

    return read


def _range(entry: Table, made: Joint, old: Joint) -> Joint:
    """Return the joint with its principal coordinate's range: of ``limits``, of its table, or of the URDF."""
    short, principal = entry.numbers("limits"), made.principal
    if short is not None and not principal:
        entry.fail(f"a {made.type} joint has no principal coordinate; allowed for: {', '.join(PRINCIPAL)}", "limits")
    if short is not None and short[0] > short[1]:
        entry.fail(f"got {show(entry.values['limits'])}; allowed: [lower, upper] with lower <= upper", "limits")
    if short is not None and principal in entry and "limits" in entry.values[principal]:
        entry.fail(f"{principal} has limits in its table, too; allowed: one of them", "limits")
    if short is not None:
        return replace(made, limits=(short[0], short[1]))
    made = replace(made, limits=old.limits if made.type == old.type else None)
    if principal not in made.coordinates:
        return made
    limits, before = made.coordinates[principal].limits or Limits(), made.limits or (None, None)
    lower, upper = (x if y is None else y for x, y in zip(before, (limits.lower, limits.upper), strict=True))
    whole = replace(limits, lower=lower, upper=upper)
    conflict = limits_conflict(whole)
    if conflict is not None:
        entry.fail(conflict[1], f"{principal}.{conflict[0]}")
    return made.with_limits(principal, whole)


def _placement(entry: Table, old: Placement) -> Placement:
    dh, placement = entry.table("dh") if "dh" in entry else None, entry.table("placement")
    if dh is not None and placement is not None:
        entry.fail("both dh and placement are set; allowed: one of them")
    if dh is not None:
        return Placement.from_dh(dh.number("a") or 0.0, dh.angle("alpha"), dh.number("d") or 0.0, dh.angle("theta"))
    return old if placement is None else read_placement(placement)


def _frame(name: str, entry: Table, draft: Draft) -> Frame:
    entry.require()
    link = on_node(entry, "node", entry.text("link") or "", entry.text("node"), draft)
    return Frame(name, link, _placement(entry, Placement()))


def _resolve_base(draft: Draft) -> None:
    """Determine the name of the ground where TOML refines a URDF.

    'base' means the URDF's root link.  But if a joint of the TOML carries that root (a floating base, say), the root
    is a link like others, and that joint's parent, 'base' or 'world', is the ground.
    """
    root = draft.base
    parents = [joint.parent for joint in draft.joints.values() if joint.child == root]
    if parents and parents[0] in _WORLD and parents[0] not in draft.links:
        draft.base = parents[0]
    elif BASE not in draft.links and root != BASE:
        for name, joint in draft.joints.items():
            if joint.parent == BASE:
                draft.joints[name] = Joint(**{**vars(joint), "parent": root})
        for name, beam in draft.beams.items():
            draft.beams[name] = replace(beam, parent=root if beam.parent == BASE else beam.parent)
        for name, frame in draft.frames.items():
            if frame.link == BASE:
                draft.frames[name] = Frame(name, root, frame.placement)
        between: tuple[dict[str, Any], ...] = (draft.loops, draft.elements)
        for items in between:
            for name, item in items.items():
                items[name] = replace(item, links=tuple(root if link == BASE else link for link in item.links))


def _active_friction(robot: Robot) -> Iterator[str]:
    """Say where the damping of bristles can give energy back."""
    for prefix, kind, coordinate in robot.coordinate_laws():
        above = active_above(coordinate.law())
        if above is not None:
            unit = "m/s" if kind in LINEAR else "rad/s"
            yield (
                f"{prefix}.friction: above {above:.3g} {unit} its bristle_damping can give energy back, as that of the"
                " published model; fade makes it passive"
            )


def _finish(draft: Draft, policy: str | None, tunable: list[str]) -> Robot:
    """Make a Robot of the draft, with the checks that need the whole description."""
    joints = ordered_joints(draft)
    draft.check_ends()
    if not any(joint.coordinates for joint in joints):
        allowed = "at least one joint that moves"
        if draft.base in draft.links:
            allowed += ", or --floating-base (floating_base=True): its root link moves"
        draft.fail("joints", f"no joint has a coordinate, so nothing moves; allowed: {allowed}")
    _check_pairs(draft, joints)
    links, notes = _bodies(draft, joints, policy)
    elements = draft.elements.values()
    robot = Robot(
        name=draft.name,
        gravity=draft.gravity,
        links=links,
        joints=tuple(joints),
        frames=tuple(draft.frames.values()),
        base=draft.base,
        source=draft.source,
        notes=(*draft.notes, *notes),
        loops=tuple(draft.loops.values()),
        springs=tuple(x for x in elements if isinstance(x, Spring)),
        elements=tuple(x for x in elements if isinstance(x, Element)),
        driven=draft.driven,
        home=draft.home,
        couplings=tuple(draft.couplings.values()),
        beams=tuple(draft.beams.values()),
    )
    conflict = mechanism_conflict(robot)
    if conflict is not None:
        draft.fail(*conflict)
    more = {"notes": (*robot.notes, *_active_friction(robot)), "tunable": expand_tunable(robot, tunable)}
    return Robot(**{**vars(robot), **more})


def _check_pairs(draft: Draft, joints: Sequence[Joint]) -> None:
    """Raise DescriptionError if no joint moves between the two links of a loop or force element."""
    carrier = {draft.base: draft.base}
    for joint in joints:
        carrier[joint.child] = joint.child if joint.coordinates else carrier[joint.parent]
    for where, (first, second) in draft.pairs.items():
        if carrier[first] == carrier[second]:
            draft.fail(where, unmoved(first, second))


def _bodies(draft: Draft, joints: Sequence[Joint], policy: str | None) -> tuple[tuple[Link, ...], tuple[str, ...]]:
    """Return the links that joints carry, in the joints' order, and notes on their inertias.

    The ground is none of them: its inertia has no effect.

    Args:
        policy: None: "warn" for inertias of a URDF or MJCF, as most readers take them, "error" for those of TOML.
    """
    if policy not in (None, *POLICIES):
        draft.fail("inertia", f"got {show(policy)}; allowed: {', '.join(POLICIES)}")
    names = [joint.child for joint in joints]
    sizes = link_sizes(draft.links, joints)
    judged = [
        Judged(draft.links[name], policy or ("warn" if name in draft.foreign else "error"), sizes[name])
        for name in names
    ]
    return apply_inertia_policy(judged, source=draft.source, spots=draft.spots)
