"""Yield of a study: rows that settle within a spec, and their draws."""

import numpy as np
import pytest

from ann_dc.study.yield_metrics import draws_of, good_rows, yield_of


def test_what_failed_or_is_missing_does_not_pass():
    spec = {"control_error": 0.1, "settling_time": (5.0, 50.0)}
    good = ("settled", 0.05, 40.0)
    rows = [
        good,
        ("diverged", *good[1:]),
        ("settled", 0.2, 40.0),
        ("settled", np.nan, 40.0),
        ("settled", 0.05, 4.0),
        ("settled", 0.05, 51.0),
        ("failed", np.nan, np.nan),
    ]
    names = ("outcome", "control_error", "settling_time")
    columns = {name: np.array(values) for name, values in zip(names, zip(*rows))}
    assert good_rows(columns, spec).tolist() == [True] + 6 * [False]
    assert yield_of(columns, spec).count == 7
    assert yield_of(columns, {}).passed == 5


SEEDS = np.tile([3, 5, 7, 9], 2)
MISMATCH = "nonideal.mismatch"
SETTINGS = {
    "a defect under two words": ({MISMATCH: [0.01] * 8, "design.preconditioner": [*"aaaabbbb"]}, 4),
    "a defect of size zero": ({MISMATCH: [0.0] * 8, "design.preconditioner": [*"aaaabbbb"]}, 0),
    "sizes zero and one percent": ({MISMATCH: [0.0] * 4 + [0.01] * 4}, 4),
    "places in a range": ({"input.q_d.x": np.arange(8.0)}, 4),
    "tolerances": ({"tolerance.resistor": [0.01] * 8}, 4),
    "random starts": ({"initial_guess.spread": [0.1] * 8}, 4),
    "starts on the line": ({"initial_guess.kind": ["line"] * 8}, 0),
    "nothing set": ({}, 0),
}


@pytest.mark.parametrize(("settings", "draws"), SETTINGS.values(), ids=SETTINGS)
def test_draws_of_rows_are_their_seeds_where_something_is_drawn(settings, draws):
    columns = {name: np.array(values) for name, values in settings.items()}
    assert draws_of({"seed": SEEDS, **columns}) == draws
    assert draws_of(columns) is None


def test_a_grid_without_draws_has_no_interval():
    assert draws_of({"seed": np.full(3, 5), "gains.rho": np.array([0.3, 1.0, 3.0])}) == 0
