"""The paper's robot of section 6 in the paper's letters: rod of mass m and length l, stiffness a, any gravity."""

from __future__ import annotations

from typing import Any

import sympy as sp

from eomgen.codegen.closed_form.trace import ClosedForm, closed_form
from eomgen.description.load import load_robot
from eomgen.robot.model import build_model

m, length, stiffness = sp.symbols("m l a", positive=True)
gravity = sp.symbols("g_x g_y g_z", real=True)


def one_link() -> ClosedForm:
    """The paper's robot with its letters for parameters and gravity along any axis."""
    moment = m * length**2 / 12
    letters: dict[str, Any] = {
        "links.link1.mass": m,
        "links.link1.com.x": length / 2,
        "links.link1.inertia.yy": moment,
        "links.link1.inertia.zz": moment,
        "joints.joint1.x.stiffness": stiffness,
    }
    letters |= {f"gravity.{axis}": g for axis, g in zip("xyz", gravity, strict=True)}
    return closed_form(build_model(load_robot("one_link")), letters)


def equal(found: Any, expected: Any) -> bool:
    return bool(sp.simplify(sp.nsimplify(found) - expected) == 0)
