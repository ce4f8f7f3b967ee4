"""Words for objects in calls and in fields."""

import numpy as np
import pytest

import ann_dc
from ann_dc import PreconditionerKind, plants
from ann_dc.backends.integration.methods import METHODS
from ann_dc.backends.step_rules import ORDERS
from ann_dc.decomposition.form import FORMS
from ann_dc.errors import ArgumentTypeError, NetworkError, UnknownNameError
from ann_dc.hardware.parts.e_series import SERIES
from ann_dc.hardware.parts.level_words import FOR_A_NETWORK, level_words
from ann_dc.network.preconditioners.base import KINDS

PROBLEM = plants.double_integrator(N=3)


def spellings(word):
    return {word, word.upper(), word.replace("-", "_"), word.replace("-", " "), f" {word} "}


@pytest.mark.parametrize("word", METHODS)
def test_method_word_gives_the_method(word):
    assert all(ann_dc.OdeBackend(method=w).method is METHODS[word] for w in spellings(word))


@pytest.mark.parametrize("word", ORDERS)
def test_order_word_gives_the_order(word):
    assert all(ann_dc.RecurrentBackend(order=w).order is ORDERS[word] for w in spellings(word))


@pytest.mark.parametrize("word", SERIES)
def test_series_word_gives_the_series(word):
    found = (word, word.lower(), word.replace(" ", "-"))
    assert all(ann_dc.SpiceBackend(series=w).series is SERIES[word] for w in found)


@pytest.mark.parametrize("word", sorted({*level_words()} - {*FOR_A_NETWORK}))
def test_level_word_gives_the_level(word):
    expected = level_words()[word].made()
    assert all(ann_dc.SpiceBackend(level=w).level.name == expected.name for w in spellings(word))


def test_level_word_that_needs_a_network_is_refused_with_a_remedy():
    with pytest.raises(NetworkError, match=r"use ann_dc\.levels\.switched_capacitor"):
        ann_dc.SpiceBackend(level="switched-capacitor")


@pytest.mark.parametrize("word", FORMS)
def test_form_word_gives_the_form(word):
    problem = plants.double_integrator(N=3)
    assert all(ann_dc.decompose(problem, w).form == FORMS[word] for w in spellings(word))


@pytest.mark.parametrize("word", KINDS)
def test_kind_word_designs_like_the_kind(word):
    designed = ann_dc.design(PROBLEM, preconditioner=word)
    assert designed.network.preconditioner.kind is KINDS[word]
    assert ann_dc.GainRule(kind=word).kind is KINDS[word]


def test_list_may_mix_words_and_kinds():
    mixed = ann_dc.design(PROBLEM, preconditioner=["Resistive_Grid", PreconditionerKind.DIAGONAL])
    kinds = (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.DIAGONAL)
    same = ann_dc.design(PROBLEM, preconditioner=kinds)
    assert mixed.network.preconditioner.kind is same.network.preconditioner.kind
    assert np.array_equal(mixed.state, same.state)


@pytest.mark.parametrize(("word", "function"), [
    ("line", ann_dc.interpolated_guess),
    ("zero", ann_dc.zero_guess),
    ("random", lambda problem: ann_dc.random_guess(problem, 0)),
])  # fmt: skip
def test_guess_word_starts_where_its_function_does(word, function):
    start = ann_dc.synthesize(PROBLEM, initial_guess=word).start_state
    for same in (function, function(PROBLEM)):
        assert np.array_equal(start, ann_dc.synthesize(PROBLEM, initial_guess=same).start_state)


def test_solve_accepts_words_for_all_choices():
    solution = ann_dc.solve(
        PROBLEM, form="S14", preconditioner="diagonal", initial_guess="zero", backend="recurrent"
    )
    assert solution.certified
    assert solution.network.preconditioner.kind is PreconditionerKind.DIAGONAL


@pytest.mark.parametrize(("call", "message"), [
    (lambda: ann_dc.solve(PROBLEM, preconditioner="multilevl"),
     r"preconditioner: 'multilevl' does not exist; closest: multilevel .*; choose one of: diag"),
    (lambda: ann_dc.design(PROBLEM, preconditioner=["diagonl"]), r"closest: diagonal; choose"),
    (lambda: ann_dc.solve(PROBLEM, form="print"), r"form: 'print' .* closest: printed"),
    (lambda: ann_dc.solve(PROBLEM, backend="odee"), r"closest: ode; choose one of: ode, recurrent"),
    (lambda: ann_dc.solve(PROBLEM, initial_guess="zeros"), r"initial_guess: .* closest: zero;"),
    (lambda: ann_dc.OdeBackend(method="RK54"), r"method: 'RK54' does not exist; closest: RK45"),
    (lambda: ann_dc.SpiceBackend(series="E48"), r"series: 'E48' does not exist"),
])  # fmt: skip
def test_unknown_word_names_the_closest_and_all(call, message):
    with pytest.raises(UnknownNameError, match=message):
        call()


def test_word_is_no_object_where_none_are_declared():
    with pytest.raises(ArgumentTypeError, match="network: expected a Network"):
        ann_dc.OdeBackend().run("car")
