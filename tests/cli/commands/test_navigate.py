"""``ann-dc navigate``: what is written and said, with a planner whose answers are known."""

import journeys
import pytest
from command_line import printed_json, run

WORLD = """
start = [0, 0, 0]
goal = [1.0, 0.05]
arrived = 0.3
robot = {kind = "unicycle"}
discs = [{centre = [0.5, 1.5], radius = 0.3}]
"""
DESIGN = "ann_dc.navigation.planner_design.design_planner"


@pytest.fixture
def yard(tmp_path, monkeypatch):
    monkeypatch.setattr(DESIGN, lambda robot, **given: journeys.Ahead())
    path = tmp_path / "yard.toml"
    path.write_text(WORLD, encoding="utf-8")
    return path


def test_pictures_are_written_and_the_end_is_told(yard, tmp_path):
    code, said = run("navigate", yard, "--output", tmp_path / "out", "--animation")
    assert code == 0
    assert "reached the goal" in said
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"journey.png", "journey.gif"}


def test_one_that_gives_up_is_no_success(yard, tmp_path):
    yard.write_text(WORLD.replace("[1.0, 0.05]", "[9, 9]") + "duration = 0.3\n", encoding="utf-8")
    assert run("navigate", yard, "--output", tmp_path)[0] == 1


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["--planner", "magic"], "--planner"),
        (["--settling-budget", "-3"], "--settling-budget"),
    ],
)
def test_bad_words_are_refused(yard, tmp_path, words, reported):
    code, said = run("navigate", yard, "--output", tmp_path, *words)
    assert code == 2
    assert reported in said


def test_a_bad_world_is_told_with_its_field(yard, tmp_path):
    yard.write_text(WORLD.replace("radius = 0.3", "radius = -1"), encoding="utf-8")
    code, said = run("navigate", yard, "--output", tmp_path)
    assert code == 2
    assert "discs[0].radius" in said


def test_navigate_json_dash_prints_only_json(yard, tmp_path):
    code, data = printed_json("navigate", yard, "--output", tmp_path)
    assert code == 0
    assert (data["arrived"], data["collided"], data["planner"]) == (True, False, "network")
    assert len(data["q"][0]) == len(data["u"][0]) + 1
