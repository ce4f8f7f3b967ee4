"""Settling against gains, against closed forms and runs on both sides of a boundary."""

import dataclasses

import numpy as np
import pytest

import ann_dc
from ann_dc.study.library.settling import boundaries, settling_against_gains
from ann_dc.study.table import Table


def test_every_population_has_a_study():
    studies = settling_against_gains("car", factors=[0.5, 2.0])
    assert tuple(studies) == ("rho", "tau.q", "tau.u", "tau.t", "tau.mu", "tau.beta")
    assert len(studies["tau.beta"]) == 2
    assert studies["rho"].vary == {"gains.rho": [0.5, 2.0]}


def test_the_boundary_is_where_the_rate_crosses_zero_over_the_logarithm():
    factors = np.array([0.01, 0.1, 1.0, 10.0])
    rates = np.log10(factors / 0.03)  # zero at 0.03, and straight over the logarithm
    table = Table(columns={"gains.rho": factors, "resting_decay_rate": rates}, spec={})
    assert boundaries(table, "rho") == pytest.approx([0.03])
    twice = dataclasses.replace(
        table, columns={**table.columns, "resting_decay_rate": np.array([-1.0, 1.0, 1.0, -1.0])}
    )
    assert boundaries(twice, "rho") == pytest.approx([10**-1.5, 10**0.5])
    flat = dataclasses.replace(table, columns={**table.columns, "resting_decay_rate": np.ones(4)})
    assert boundaries(flat, "rho") == ()


def test_all_time_constants_together_change_nothing_in_fastest_ones():
    network = ann_dc.design(
        ann_dc.plants.double_integrator(N=5), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    ).network
    (study,) = settling_against_gains(network, factors=[0.25, 1.0, 4.0], gains=["tau"]).values()
    table = study.run(workers=0)
    times, reported = table["normalised_settling_time"], table["settling_by_spectrum"]
    np.testing.assert_allclose(times, times[1], rtol=1e-3)
    np.testing.assert_allclose(reported, reported[1], rtol=1e-6)
    assert boundaries(table, "tau") == ()
