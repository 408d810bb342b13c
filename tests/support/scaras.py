"""A SCARA, whose tool turns about the vertical alone."""

from __future__ import annotations


def scara() -> str:
    """Its description: two arms of 0.4 and 0.3 m, a stroke of 0.3 m, and a wrist."""
    joints = [
        ("arm1", "revolute", "base", [0.0, 0.0, 0.5], [-2.4, 2.4]),
        ("arm2", "revolute", "link1", [0.4, 0.0, 0.0], [-2.5, 2.5]),
        ("stroke", "prismatic", "link2", [0.3, 0.0, 0.0], [-0.1, 0.2]),
        ("wrist", "revolute", "link3", [0.0, 0.0, 0.0], [-3.0, 3.0]),
    ]
    lines = ["name = 'scara'"]
    for i, (name, kind, parent, xyz, limits) in enumerate(joints):
        lines += [f"[[links]]\nname = 'link{i + 1}'\nmass = 2.0\ncom = [0.1, 0.0, 0.0]"]
        lines += ["inertia = { xx = 0.02, yy = 0.02, zz = 0.02 }"]
        lines += [f"[[joints]]\nname = '{name}'\ntype = '{kind}'\nparent = '{parent}'\nchild = 'link{i + 1}'"]
        lines += [f"placement = {{ xyz = {xyz} }}\nlimits = {limits}"]
    return "\n".join([*lines, "[[frames]]\nname = 'tcp'\nlink = 'link4'\nplacement = { xyz = [0.0, 0.0, -0.1] }"])
