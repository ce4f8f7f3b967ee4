"""Equations, cell and counts of what is wired for a problem."""

import re

import pytest
from command_line import PENDULUM, ROOT, refused, run


def test_show_gives_equations_and_counts_by_default():
    code, text = run("show", "car")
    assert code == 0
    assert "tau deta/ds" in text
    assert "multipliers" in text
    assert "a network value of 1 is" in text


@pytest.mark.parametrize(
    ("options", "there", "not_there"),
    [
        (["--equations"], "tau deta/ds", "multipliers"),
        (["--counts"], "multipliers", "tau deta/ds"),
        (["--latex"], r"\begin{align*}", "multipliers"),
        (["--cell"], "u.nu times cos(phi)", "multipliers"),
        (["--cell"], "q.x of cell 0 is the input q_0.x", "tau deta/ds"),
        (["--form", "s8", "--equations"], "with S8", "corrected"),
        (["--set", "D=0.5", "--equations"], "0.2*nu*tan(varphi)", "0.1*nu*tan(varphi)"),
        (["--scales"], "q.y 5 m 0 m", "multipliers"),
        (["--scales", "--set", "scale.y=1000"], "q.y 1000 m 0 m", "q.y 5 m"),
        (["--scales", "--set", "scale.cost=7"], "cost 7 ", "tau deta/ds"),
        (["--scales", "--q-0", "1,2,0,0"], "q.y 3 m 2 m", "tau deta/ds"),
    ],
)
def test_show_options(options, there, not_there):
    code, text = run("show", "car", *options)
    assert code == 0
    assert there in text
    assert not_there not in text


BAD = {
    "no saved solution": (["show", ROOT / "tests"], "SHA256SUMS' does not exist"),
    "a saved solution changed": (["show", ROOT / "tests", "-N", "5"], "cannot be changed"),
    "unknown plant to show": (["show", "unicicle"], "did you mean unicycle"),
    "no scale": (["show", "car", "--set", "scale.x=0"], "scales[x]: expected a positive finite"),
    "word as scale": (["show", "car", "--set", "scale.x=far"], "scale.x: expected a finite number"),
    "scale of nothing": (["show", "car", "--set", "scale.z=3"], "none of x, y, phi, varphi, nu"),
    "unknown form to show": (["show", "car", "--form", "x"], "printed-example, S1"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)


def test_what_is_to_hold_is_shown(tmp_path):
    file = tmp_path / "limited.toml"
    text = PENDULUM.read_text(encoding="utf-8")
    held = """
[constraints]
pace = "-9 <= omega <= 9"
[terminal_constraints]
near = "theta**2 <= 1"
[bounds]
torque = [-3, "none"]
theta = [-4, 4]
"""
    file.write_text(text + held, encoding="utf-8")
    code, text = run("show", file)
    assert code == 0
    for line in (
        "at every stage: pace_low, -9 <= omega",
        "at every stage: pace_high, omega <= 9",
        "at the end: near, theta**2 <= 1",
        "bounds: -3 <= torque, in rad/s^2",
        "bounds: -4 <= theta <= 4, in rad",
    ):
        assert line in text
    assert "at every stage" not in run("show", PENDULUM)[1]
    assert "at every stage" not in run("show", file, "--latex")[1]


def test_a_file_keeps_the_scales_that_the_command_line_leaves(tmp_path):
    file = tmp_path / "masses.toml"
    text = PENDULUM.read_text(encoding="utf-8")
    file.write_text(f"{text}\n[scales]\ntheta = 8\nomega = 4\n", encoding="utf-8")
    code, text = run("show", file, "--scales", "--set", "scale.omega=2")
    assert code == 0
    assert re.search(r"q\.theta 8 ", text)
    assert re.search(r"q\.omega 2 ", text)


def test_a_step_length_that_is_chosen_is_told():
    code, text = run("show", "car_free_time", "--counts", "--set", "low=0.1", "--set", "high=0.4")
    assert code == 0
    assert (
        "step length h: 0.1 to 0.4 s, determined by the network from the initial value 0.2 s"
        in text
    )
    assert "9 stages last 1.8 s; h = 0.15*sin(h_free" in text
    assert "step length" not in run("show", "car_free_time", "--set", "dt=0.3", "--counts")[1]


def test_ends_of_a_file_are_those_that_its_author_knows(tmp_path):
    text = PENDULUM.read_text(encoding="utf-8").replace("dt = 0.075", "dt = {low = 0.01}")
    (tmp_path / "swing.toml").write_text(text, encoding="utf-8")
    words = ["show", tmp_path / "swing.toml", "--counts"]
    code, text = run(*words, "--q-0", "3,free", "--q-d", "0,0")
    assert code == 0
    assert "step length h: at least 0.01 s" in text
    assert run(*words, "--q-0", "3,0,0")[0] == 2
    code, text = run(*words, "--set", "dt=0.1")
    assert code == 2
    assert "dt: got 0.1, but the step length of this problem is free" in text
