"""A package of ROS 2 around a generated project: a plant free of ROS, and a component that moves it.

From a package's metadata, without SymPy.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from eomgen._version import __version__
from eomgen.errors import InputError

from ..names import safe
from ..source import environment

TEMPLATES = {
    "package.xml": "package.xml.jinja",
    "CMakeLists.txt": "CMakeLists.txt.jinja",
    "plant.hpp": "plant.hpp.jinja",
    "component.cpp": "component.cpp.jinja",
    "launch/robot.launch.py": "robot.launch.py.jinja",
}


def ros2_files(meta: Mapping[str, Any]) -> dict[str, str]:
    """Return names and texts of a ROS 2 package that lies in a folder ``ros2`` of the generated project.

    Args:
        meta: of ``metadata``, as in the package's .json.

    Raises:
        InputError: the package has no rollouts, by which the component moves.
    """
    if "rollout" not in {function["kind"] for function in meta["functions"].values()}:
        raise InputError("--ros2 needs the kernel rollout; allowed: --kernels with rollout, or without --kernels")
    name = meta["name"]
    numbers = [*re.findall(r"\d+", __version__)[:3], "0", "0"][:3]
    words = re.sub(r"_+", "_", name.lower()).strip("_")
    context = {
        "name": name,
        "package": f"eomgen_{words}_ros2" if words else "eomgen_robot_ros2",
        "space": safe(name),
        "version": __version__,
        "three_numbers": ".".join(numbers),
        "internal_states": len(meta.get("internal_states", ())),
        "inputs": meta.get("inputs", {}),
    }
    return {file: environment().get_template(f"ros2/{text}").render(context) for file, text in TEMPLATES.items()}
