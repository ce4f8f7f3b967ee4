"""Equations, cell and counts of what is wired for a problem."""

import pytest
from command_line import refused, run


def test_show_gives_equations_and_counts_by_default():
    code, text = run("show", "car")
    assert code == 0
    assert "tau deta/ds" in text
    assert "multipliers" in text


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
    ],
)
def test_show_options(options, there, not_there):
    code, text = run("show", "car", *options)
    assert code == 0
    assert there in text
    assert not_there not in text


BAD = {
    "unknown plant to show": (["show", "unicicle"], "did you mean unicycle"),
    "unknown form to show": (["show", "car", "--form", "x"], "corrected, printed, S1"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)
