"""Sizes of coordinates and rates, from the description's numbers: what tolerances refer to by default."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eomgen.arrays import Array
from eomgen.errors import InputError
from eomgen.names import joint_of
from eomgen.robot.laws import stiffness_of
from eomgen.robot.model import Model
from eomgen.robot.parameter_names import CUTS, JOINTS, element_places
from eomgen.robot.sizes import deviation_sizes

from ...forces.element import POLE
from ...program.ir import evaluate, finish
from ...program.passes import PARAMETERS
from ..derivation import Derivation, vector
from ..interface import knots


def coordinate_sizes(model: Model) -> tuple[Array, Array]:
    """Return sizes of coordinates, and of rates with internal states behind them, at home: see ``deviation_sizes``."""
    inertia, beside = _at_home(model)
    q, v = deviation_sizes(_coordinate_stiffness(model) + beside, inertia)
    return q, np.append(v, [x.state.size(x.numbers) for x in model.states])


def rubbing_parameters(model: Model) -> list[tuple[int, str]]:
    """Place the coordinates with friction, each with a parameter that is a rate in which it turns round.

    Friction in cut joints and couplings counts for all coordinates of the robot.
    """
    names, places = list(model.parameters), element_places(model.robot, model.parameters)
    joints, cut = places[JOINTS], places[CUTS].values()
    acting = [(i, x) for i, name in enumerate(model.coordinates) for x in (joints.get(name, {}), *cut)]
    led = [(x, joints.get(name, {})) for name, leaders in model.leaders.items() for x in leaders]
    acting += [(model.coordinates.index(x), law) for x, law in led]
    return [(i, names[x["friction.smoothing"]]) for i, x in acting if "friction.smoothing" in x]


def _table_stiffnesses(model: Model, names: Sequence[str]) -> Array:
    """Return stiffnesses of the tables of coordinates, or of what follows them, by their names."""
    values, curves = list(model.parameters.values()), knots(model)
    places = element_places(model.robot, model.parameters)[JOINTS]
    tables = {name: {key: values[place] for key, place in numbers.items()} for name, numbers in places.items()}
    return np.array([stiffness_of(tables.get(name, {}), curves.get(name, ())) for name in names])


def _coordinate_stiffness(model: Model) -> Array:
    """Return the stiffness of each coordinate's table; a transmission holds its motor and its joint."""
    tables = _table_stiffnesses(model, model.coordinates)  # those of followers stand beside
    stiffness = tables.copy()
    for index, principal in model.motors.items():
        motor = model.robot.joint(joint_of(model.coordinates[index])).motor
        assert motor is not None
        stiffness[principal] += tables[index]
        stiffness[index] /= motor.ratio**2
    return np.asarray(stiffness)


def _at_home(model: Model) -> tuple[Array, Array]:
    """Return the diagonals of M at home, and of what point-to-point springs and cut joints stiffen there."""
    d = Derivation(model)
    _refuse_poles(d)
    M = d.followers.symmetric(d.matrix()) if d.followers else d.matrix()
    stiff = [0.0] * d.model.size
    tables = _table_stiffnesses(model, tuple(model.followers))
    for name, k in zip(model.followers, tables.tolist(), strict=True):
        stiff[d.model.coordinates.index(name)] = k
    for element in d.elements:
        for i, k in element.stiffnesses():
            stiff[i] = stiff[i] + k
    for follower, share in d.followers.shares.items():  # what couples coordinates beside is left out
        for i, ratio in share.items():
            stiff[i] = stiff[i] + stiff[follower] * (ratio * ratio)
    n, values = len(d.active), [M[i, i] for i in d.active] + [stiff[i] for i in d.active]
    program = finish(d.graph, "sizes", vector(values))
    outputs = evaluate(program, _numbers_at_home(model))
    diagonals = np.array([float(outputs["out", i]) for i in range(2 * n)])
    return diagonals[:n], diagonals[n:]


def _refuse_poles(d: Derivation) -> None:
    """Refuse a home at which a cut joint's angles with forces are singular: nothing there has a size.

    Raises:
        InputError: beta is at +-pi/2 there, and coordinates move angles that have tables.
    """
    moving = [*d.active, *(i for i, share in d.followers.shares.items() if share)]
    poles = [pole for element in d.elements for pole in element.poles(moving)]
    program = finish(d.graph, "poles", vector([cosine for _, cosine in poles]))
    cosines = evaluate(program, _numbers_at_home(d.described))
    for (name, _), cosine in zip(poles, cosines.values(), strict=True):
        if cosine < POLE:
            raise InputError(
                f"{d.described.name}: home puts {name} at beta = +-90 degrees, where alpha and gamma turn"
                " about one axis, and steps by tolerances refer to what is at home; allowed: another home, or"
                f" {name}.placements whose frames are turned otherwise"
            )


def _numbers_at_home(model: Model) -> dict[str, list[float]]:
    """Return inputs of programs: the coordinates at home, and the description's parameters."""
    return {"q": list(model.home), PARAMETERS: list(model.parameters.values())}
