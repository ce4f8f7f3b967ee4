"""Figures of errors over time, steps and seconds, by the numbers in their lines."""

from functools import cache

import numpy as np
import pytest
from simulator import needs_ngspice

import ann_dc
from ann_dc import plotting
from ann_dc.errors import NetworkError
from ann_dc.optimality.reference_solvers import solver_iterates
from ann_dc.two_level import NewtonCoordinator

PROBLEM = ann_dc.plants.double_integrator(N=5)
METHODS = {name: ann_dc.ode.METHODS[name] for name in ("RK45", "Radau", "compiled")}


@cache
def solution():
    return ann_dc.solve(PROBLEM)


@cache
def runs():
    network = solution().network
    found = {n: ann_dc.OdeBackend(method=m, verify=False).run(network) for n, m in METHODS.items()}
    return found | {"recurrent": ann_dc.RecurrentBackend().run(network)}


def lines_of(figure):
    return {line.get_label(): line.get_xydata() for line in figure.axes[0].lines}


def test_residuals_over_time_are_those_of_the_runs():
    found = lines_of(plotting.convergence(runs()))
    for name, run in runs().items():
        time, values = found[name].T
        np.testing.assert_array_equal(time, run.trajectory.residual_time)
        np.testing.assert_allclose(values, np.maximum(run.trajectory.kkt, 1e-12))
    assert "tolerance 1e-06" in found


def test_circles_mark_the_settling_times():
    run = runs()["RK45"]
    for against, at in (("time", run.settling_time), ("steps", run.settling_steps)):
        axes = plotting.convergence({"RK45": run}, against=against).axes[0]
        [circle] = [line for line in axes.lines if line.get_marker() == "o"]
        (x, y) = circle.get_xydata()[0]
        assert y == 1e-6
        assert x == pytest.approx(at, rel=1e-12 if against == "time" else 0.03)


def test_circle_marks_the_outer_iteration_of_two_levels():
    levels = ann_dc.TwoLevels(solution().network, upper=NewtonCoordinator()).run()
    axes = plotting.convergence({"two levels": levels}, against="steps").axes[0]
    [circle] = [line for line in axes.lines if line.get_marker() == "o"]
    assert circle.get_xdata()[0] == levels.outer_iterations[0]


def test_unsettled_run_has_no_circle():
    short = ann_dc.OdeBackend(verify=False, duration=5.0).run(solution().network)
    axes = plotting.convergence({"short": short}).axes[0]
    assert not [line for line in axes.lines if line.get_marker() == "o"]


def test_steps_are_counted():
    levels = ann_dc.TwoLevels(solution().network, upper=NewtonCoordinator()).run()
    both = runs() | {"two levels": levels, "IPOPT": solver_iterates(PROBLEM)}
    found = lines_of(plotting.convergence(both, against="steps"))
    for name, run in runs().items():
        assert found[name][-1, 0] == run.steps
    np.testing.assert_array_equal(found["two levels"][:-1, 1], levels.residuals[:-1, 0])


def test_errors_of_controls_are_those_from_the_optimum():
    end = solution().trajectory.control_values[-1]
    found = lines_of(plotting.convergence(runs(), error="controls", optimum=solution()))
    run = runs()["RK45"].trajectory
    wanted = np.abs(run.control_values - end).max(axis=1) / np.abs(end).max()
    time, values = found["RK45"].T
    np.testing.assert_allclose(values, np.maximum(np.interp(time, run.time, wanted), 1e-12))
    assert values[0] > 0.1
    assert values[-1] < 1e-6


def test_a_run_that_settles_elsewhere_does_not_look_right():
    """Its own end is not what its controls are related to."""
    other = solution().network.with_inputs({"q_d.x": 2.0})
    there = ann_dc.OdeBackend(verify=False).run(other)
    found = lines_of(plotting.convergence({"wrong": there}, error="controls", optimum=solution()))
    assert found["wrong"][-1, 1] > 0.1


def test_cost_falls_to_that_of_the_optimum():
    both = runs() | {"solve": solution(), "IPOPT": solver_iterates(PROBLEM)}
    found = lines_of(plotting.convergence(both, against="steps", error="objective"))
    assert all(values[-1, 1] < 1e-6 for name, values in found.items())


@needs_ngspice
def test_networks_take_the_time_of_the_circuit():
    network = ann_dc.design(PROBLEM, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    circuit, ideal = ann_dc.SpiceBackend().run(network), ann_dc.OdeBackend().run(network)
    both = {"circuit": circuit, "ideal": ideal, "IPOPT": solver_iterates(PROBLEM)}
    found = lines_of(plotting.convergence(both, against="seconds"))
    unit = circuit.deck.timing.unit
    np.testing.assert_allclose(found["ideal"][:, 0], unit * ideal.trajectory.residual_time)
    assert found["IPOPT"][-1, 0] > 10 * found["circuit"][-1, 0]


def test_a_sequence_of_runs_is_numbered():
    assert {"run 1", "run 2"} <= lines_of(plotting.convergence([*runs().values()][:2])).keys()


@pytest.mark.parametrize(
    ("given", "settings", "named"),
    [
        ({}, {}, "runs: expected at least one"),
        (
            {"RK45": 0},
            {"against": "seconds"},
            r"runs\['RK45'\]: against: only circuits have seconds",
        ),
        ({"RK45": 0}, {"error": "objective"}, r"runs\['RK45'\]: error: the cost belongs to a"),
        ({"two levels": 0}, {}, r"runs\['two levels'\]: .*against='steps'"),
        ({"IPOPT": 0}, {}, r"runs\['IPOPT'\]: .*'seconds'"),
    ],
)
def test_an_axis_that_a_run_has_not_is_named(given, settings, named):
    known = {
        "RK45": lambda: runs()["RK45"],
        "two levels": lambda: ann_dc.TwoLevels(solution().network, upper=NewtonCoordinator()).run(),
        "IPOPT": lambda: solver_iterates(PROBLEM),
    }
    with pytest.raises(NetworkError, match=named):
        plotting.convergence({name: known[name]() for name in given}, **settings)


def test_errors_from_an_optimum_that_moves_are_refused():
    moving = ann_dc.Waveform(times=[0.0, 10.0], values=[1.0, 2.0])
    network = solution().network.with_inputs({"q_d.x": moving})
    run = ann_dc.OdeBackend(duration=20.0).run(network)
    assert plotting.convergence([run]).axes
    with pytest.raises(NetworkError, match="error: 'controls' refers to one optimum"):
        plotting.convergence([run], error="controls")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_files_are_of_the_suffix_and_equal_for_equal_figures(suffix, tmp_path):
    heads = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    files = [tmp_path / f"{i}.{suffix}" for i in range(2)]
    for file in files:
        plotting.save(plotting.convergence(runs()), file)
    first, second = (file.read_bytes() for file in files)
    assert first.startswith(heads[suffix])
    assert first == second
