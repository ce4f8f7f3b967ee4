"""Limits that are inputs: none is active where they are loose, and those of the optimum else."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from reference import ipopt

import ann_dc
from ann_dc.study.library.settling import tightened

LIMITS = [100.0, 3.0, 2.6]


def limited(most: float) -> ann_dc.OptimalControlProblem:
    problem, symbol = ann_dc.plants.double_integrator(N=10), sp.symbols("most")
    push = {"push": problem.controls[0] <= symbol}
    return replace(problem, inputs={symbol: most}, constraints=push)


def test_active_rows_are_those_of_ipopt():
    table = tightened(limited(100.0), {"most": LIMITS}).run(workers=0)
    found = [ipopt(limited(most)) for most in LIMITS]
    active = [int((each.u[0] > most - 1e-6).sum()) for each, most in zip(found, LIMITS)]
    assert table["active_rows"].tolist() == active
    assert active[0] == 0 < active[1]
    assert table["objective"] == pytest.approx([each.objective for each in found], rel=1e-6)


def test_tighter_limits_take_longer():
    table = tightened(limited(100.0), {"most": LIMITS}).run(workers=0)
    assert (np.diff(table["settling_time"]) > 0).all()


def test_ranges_are_the_same_draws_at_every_limit():
    study = tightened(limited(100.0), {"most": LIMITS}, ranges={"q_d.x": (0.5, 1.0)}, samples=2)
    drawn = [point.setting["input.q_d.x"] for point in study.points()]
    assert drawn == 3 * drawn[:2]
