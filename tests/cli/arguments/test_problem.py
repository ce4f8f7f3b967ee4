"""Which problem: plants, files, and what cannot be one."""

import math

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from command_line import PENDULUM, ROOT, refused, run

from ann_dc.cli.arguments.problem import arithmetic_of
from ann_dc.errors import AnnDcError, ProblemError

BAD = {
    "unknown plant": (["solve", "cra"], "did you mean car"),
    "unknown parameter": (["solve", "car", "--set", "E=1"], "c_over_m, gamma, dt, N, q_0, q_d"),
    "no stage": (["solve", "car", "-N", "0"], "horizon: expected a whole number of stages"),
    "no wheel base": (["solve", "car", "--set", "D=0"], "car with D=0"),
    "bad seed": (["solve", "lq", "--set", "seed=-1"], "lq with seed=-1"),
    "missing file": (["solve", "missing.toml"], "does not exist"),
    "folder": (["solve", str(ROOT)], "is a folder"),
    "file parameter": (["solve", str(PENDULUM), "--set", "effort=1"], "q_0, q_d, horizon, dt"),
    "no problem": (["solve"], "PROBLEM"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)


@pytest.mark.parametrize(
    ("cost", "meaning"),
    [
        ('"torque**2', "not valid TOML"),
        ("\"__import__('os').system('touch pwned')\"", "cost"),
        ("nan", "cost"),
        ('"speed**2"', "speed"),
    ],
)
def test_a_bad_file_is_told_with_its_name_and_never_executed(tmp_path, monkeypatch, cost, meaning):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "bad.toml"
    text = PENDULUM.read_text(encoding="utf-8")
    file.write_text(text.replace('"effort * torque**2"', cost), encoding="utf-8")
    code, text = run("solve", file)
    assert code == 2
    assert meaning in text
    assert "bad.toml" in text
    assert list(tmp_path.iterdir()) == [file]


TOO_LARGE = {
    "overflow": lambda: math.exp(1e4),
    "division": lambda: 1 / 0,
    "memory": lambda: np.empty(2**60),
    "array": lambda: np.empty((2**62, 2**62)),
    "matrix": lambda: scipy.linalg.lu_factor(np.full((2, 2), np.inf)),
    "singular": lambda: np.linalg.inv(np.zeros((2, 2))),
    "start": lambda: scipy.integrate.solve_ivp(lambda t, y: y, (0, 1), [np.inf]),
}


@pytest.mark.parametrize("compute", TOO_LARGE.values(), ids=TOO_LARGE)
def test_numbers_that_are_too_large_are_bad_input(compute):
    meaning = "car: the arithmetic failed .* choose units"
    with pytest.raises(ProblemError, match=meaning), arithmetic_of("car"):
        compute()


DEFECTS = {
    "shapes": lambda: np.zeros(3) @ np.zeros(4),
    "lengths": lambda: [*zip((1, 2), (3,), strict=True)],
    "list": lambda: [1].index(2),
    "number": lambda: int("x"),
}


@pytest.mark.parametrize("compute", DEFECTS.values(), ids=DEFECTS)
def test_defects_of_the_library_are_not_blamed_on_the_user(compute):
    with pytest.raises(ValueError) as caught, arithmetic_of("car"):  # noqa: PT011
        compute()
    assert not isinstance(caught.value, AnnDcError)
