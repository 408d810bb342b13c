"""What notebooks show of kernels and robots, and what they complete."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest

import eomgen
from eomgen.errors import InputError
from tests.support.builds import Build

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]


def cells(html: str) -> dict[str, str]:
    table = ElementTree.fromstring(html)
    return {str(row[0].text): str(row[1].text) for row in table.iter("tr")}


def test_a_kernel(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "mass_matrix", "rollout")
    assert repr(kernel) == "<Kernel one_link: 2 coordinates, float64>"
    found = cells(kernel._repr_html_())
    assert (found["coordinates"], found["functions"], found["threads"], found["checks"]) == ("2", "2", "1", "True")
    assert "<caption>Kernel one_link</caption>" in kernel._repr_html_()
    assert kernel.parameters._ipython_key_completions_() == list(kernel.parameters)
    assert len(kernel.parameters._ipython_key_completions_()) > 0


def test_a_robot() -> None:
    robot = eomgen.load_robot("one_link")
    found = cells(robot._repr_html_())
    assert (found["links"], found["joints"], found["coordinates"], found["frames"]) == ("1", "1", "2", "tcp")
    odd = replace(robot, source="<b>&\"'.toml")
    assert cells(odd._repr_html_())["source"] == "<b>&\"'.toml"


def test_functions_of_frames_may_be_asked_for_by_their_names(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    kernel = built(robot, "frame_pose")
    assert kernel.frame_pose([0.2, 0.5], "tcp").shape == (4, 4)
    other = built(robot, "kinematics", "frame_jacobian", "frame_pose")
    assert set(other.raw.functions) == set(kernel.raw.functions) == {"frame_pose", "frame_jacobian"}
    with pytest.raises(InputError, match=r"^kernels: 'pose' is unknown; allowed: mass_matrix, .*frame_pose"):
        built(robot, "pose")
