"""Worlds as text: what is read, what is refused with its field, and that nothing is executed."""

from pathlib import Path

import numpy as np
import pytest

from ann_dc.errors import FileFormatError, ScenarioError
from ann_dc.navigation.scenario import load_scenario

YARD = """
start = [0, 0, 0.5, 0]
goal = [5, 5]
sensor = 2.0

[robot]
kind = "car"
reverse = 0.5

[[discs]]
centre = [2, 2]
radius = 0.4
velocity = [0.1, 0]

[[polygons]]
corners = [[3, 3], [4, 3], [4, 3.5]]
appears = 1.0
"""


def read(tmp_path, text):
    path = tmp_path / "yard.toml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path)


def test_a_world_is_read(tmp_path):
    world = read(tmp_path, YARD)
    assert world.name == "yard"
    assert world.sensor == 2.0
    np.testing.assert_array_equal(world.robot.limits[0], [-0.5, 2.0])
    first, second = world.obstacles
    np.testing.assert_array_equal(first.velocity, [0.1, 0])
    assert (len(second.corners), second.appears) == (3, 1.0)


def test_the_demo_is_one():
    assert len(load_scenario(Path(__file__).parents[2] / "demos" / "crossing.toml").obstacles) == 5


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("radius = 0.4", "radius = -0.4", r"yard.toml: discs\[0\].radius: expected a positive"),
        ("radius = 0.4", "", r"discs\[0\].radius: missing"),
        ("radius = 0.4", "size = 0.4", r"discs\[0\].size: unknown key"),
        ('kind = "car"', 'kind = "boat"', "robot.kind: expected one of car, unicycle, got 'boat'"),
        ("reverse = 0.5", "reverse = -0.5", "robot.reverse"),
        ("goal = [5, 5]", "", "goal: missing"),
        ("goal = [5, 5]", "goal = [2, 2.1]", r"goal: .* by 0\.45 with obstacles\[0\]"),
        ("sensor = 2.0", "sensor = -2.0", "sensor"),
        ("sensor = 2.0", "sight = 2.0", "sight: unknown key"),
        ("[4, 3.5]]", "[5, 3]]", r"polygons\[0\].corners: expected a polygon"),
        ("[[discs]]", "[discs]", r"discs: expected tables, each written \[\[discs\]\]"),
    ],
)
def test_what_is_wrong_is_told_with_its_field(tmp_path, old, new, words):
    with pytest.raises((ScenarioError, FileFormatError), match=words):
        read(tmp_path, YARD.replace(old, new).replace("velocity = [0.1, 0]", ""))


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(FileFormatError, match="world file"):
        load_scenario(tmp_path / "nowhere.toml")
