"""Figure 6, (21) and Theorem IV.1 from runs of two levels."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from closed_chains import CAR, closed_chain

from ann_dc.errors import NetworkError
from ann_dc.paper.replans import Case, Iterations, replanned, to_the_letter
from ann_dc.plotting.paper.iterations import figure_6, figure_of_definitions, figure_of_following
from ann_dc.two_level.theorem import Following, Hypothesis

HYPOTHESIS = Hypothesis(eigenvalues=(np.ones(6),))


@cache
def found() -> Iterations:
    plans = replanned(closed_chain(CAR), CAR, Case(name="(a) one obstacle", stages=(4,)))
    letter = to_the_letter(CAR, closed_chain(CAR).state)
    return Iterations(
        cases=(plans,),
        letter=letter,
        gradient=letter,
        newton=letter,
        common=letter,
        following=Following(v=3.0, mu=2.0),
        hypothesis=HYPOTHESIS,
        printed_hypothesis=HYPOTHESIS,
    )


@pytest.mark.slow
def test_every_plan_has_its_lambda():
    axes = figure_6(found()).axes
    run = found().cases[0].run
    drawn = {line.get_label(): line for line in axes[0].lines}
    for sample, name in enumerate(("T_0", "T_1")):
        np.testing.assert_array_equal(drawn[name].get_ydata(), run.gains[:, 0, sample])
    assert [one.get_title(loc="left") for one in axes[:3]] == [
        "(a) one obstacle",
        "settling at T_0",
        "(28)-(30), (33) as printed",
    ]


@pytest.mark.slow
def test_true_and_printed_definitions_are_told_apart():
    A = figure_of_definitions(found()).axes[0]
    letter = found().letter
    for line, of in zip(A.lines, (letter.lyapunov, letter.printed_lyapunov)):
        np.testing.assert_array_equal(line.get_ydata(), of.A[: letter.rounds, 0])


@pytest.mark.slow
def test_the_rates_of_the_theorem_are_drawn():
    quotients = figure_of_following(found()).axes[1]
    assert [line.get_ydata()[0] for line in quotients.lines[1::2]] == [3.0, 2.0]


@pytest.mark.parametrize("draw", [figure_of_following, figure_of_definitions])
def test_a_run_without_a_solution_has_no_figure(draw):
    blind = replace(found().letter, distances=None)
    with pytest.raises(NetworkError, match="pass settled="):
        draw(replace(found(), gradient=blind, common=blind))
