"""Figure of errors over time, steps or seconds, for runs of every kind on the same axes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, TypeAlias, TypeGuard

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ann_dc.backends.run import Run
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import NetworkError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.evaluation.rules import size_of
from ann_dc.optimality.reference_solvers import SolverIterates
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION
from ann_dc.solution.solution import Solution
from ann_dc.two_level.run import TwoLevelRun
from ann_dc.validation import checked

Converging: TypeAlias = Run | CircuitRun | Solution | Trajectory | TwoLevelRun | SolverIterates
"""Result whose error can be drawn."""
Against: TypeAlias = Literal["time", "steps", "seconds"]
Error: TypeAlias = Literal["residual", "controls", "objective"]

LABELS = {"time": style.UNSCALED, "steps": "steps or iterations", "seconds": "time (s)"}
ERRORS = {
    "residual": "relative KKT residual of the network",
    "controls": "control error (relative to the largest control)",
    "objective": "relative error of the cost",
}
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, INK, GREY)
DASHES = ("-", "--", ":")
POINTS = 400
"""Largest number of states of a run at which its controls or cost are compared."""
WIDE = 30.0
"""Ratio of the longest to the shortest curve above which the horizontal axis is logarithmic."""
LEAST = 1e-12
"""Smallest error that is drawn."""


class Curve(NamedTuple):
    """Error of a run: positions (T,) on the horizontal axis and errors (T,)."""

    x: np.ndarray
    error: np.ndarray


@checked
def convergence(
    runs: Mapping[str, Converging] | Sequence[Converging],
    against: Against = "time",
    error: Error = "residual",
    *,
    optimum: Solution | None = None,
) -> Figure:
    """Plot the errors of several runs over network time, steps or seconds.

    Runs of SciPy's methods, of generated code, of recurrent steps, of two levels, of circuits and
    of digital solvers may be mixed. A circle at the tolerance marks the settling time of a run. The
    residual of a network with non-idealities is relative to its own conditions of equilibrium, not
    to those of the problem.

    Parameters
    ----------
    runs : mapping of label to run, or sequence of runs
        Results of `OdeBackend`, `RecurrentBackend`, `SpiceBackend`, `TwoLevels` (the first sample),
        `solve` or `solver_iterates`, or trajectories.
    against : {"time", "steps", "seconds"}
        Horizontal axis: network time; steps, outer iterations and iterations of a solver; or the
        seconds of circuits and solvers. Networks without a circuit have the time scale of the first
        circuit.
    error : {"residual", "controls", "objective"}
        Vertical axis. The residual of a solver is its own.
    optimum : Solution, optional
        Solution to whose controls and cost the others are related. By default the certified
        solution among the runs; for the controls else the end of the run with the smallest
        residual.

    Raises
    ------
    NetworkError
        If a run has no such axis or no such error, with its label.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> methods = {"RK45": ann_dc.ode.RK45, "Radau": ann_dc.ode.RADAU}
    >>> runs = {
    ...     name: ann_dc.OdeBackend(method=method, verify=False).run(network)
    ...     for name, method in methods.items()
    ... }
    >>> figure = convergence(runs, against="steps")
    >>> figure.axes[0].get_legend_handles_labels()[1]
    ['RK45', 'Radau', 'tolerance 1e-06']
    """
    if not len(runs):
        raise NetworkError("runs: expected at least one, got none")
    given = runs if isinstance(runs, Mapping) else {f"run {i}": r for i, r in enumerate(runs, 1)}
    known = {name: run.run if isinstance(run, Solution) else run for name, run in given.items()}
    best = optimum or next((s for s in given.values() if _is_certified(s)), None)
    unit = next((r.deck.timing.unit for r in known.values() if isinstance(r, CircuitRun)), None)
    curves, reference = {}, _Reference.of(known, best)
    for name, run in known.items():
        try:
            curves[name] = _curve(run, against, error, unit, reference)
        except NetworkError as why:
            raise NetworkError(f"runs[{name!r}]: {why}") from why
    return _drawn(curves, known, against, error)


def _is_certified(run: Converging) -> TypeGuard[Solution]:
    return isinstance(run, Solution) and run.certified


class _Reference(NamedTuple):
    """Optimum with which runs are compared, and the run nearest to it by its residual."""

    solution: Solution | None
    nearest: Trajectory | None

    @classmethod
    def of(cls, runs: Mapping[str, Converging], best: Solution | None) -> _Reference:
        if best is not None:
            return cls(best, best.run.trajectory)
        found = [t for t in map(_trajectory_of, runs.values()) if t is not None]
        return cls(None, min(found, key=lambda t: t.kkt[-1], default=None))


def _trajectory_of(run: Converging) -> Trajectory | None:
    if isinstance(run, Trajectory):
        return run
    return run.trajectory if isinstance(run, (Run, CircuitRun)) else None


# ---- curves --------------------------------------------------------------------------------------


def _curve(
    run: Converging, against: Against, error: Error, unit: float | None, reference: _Reference
) -> Curve:
    if isinstance(run, SolverIterates):
        return _of_solver(run, against, error, reference)
    if isinstance(run, TwoLevelRun):
        return _of_levels(run, against, error)
    trajectory = _trajectory_of(run)
    assert trajectory is not None
    if error == "residual":
        time, values = trajectory.residual_time, trajectory.kkt
    else:
        if trajectory.network.waveforms:
            raise NetworkError(
                f"error: {error!r} refers to one optimum, but inputs change over time; use "
                "'residual', or backends.tracking_error for the error over time"
            )
        rows = _spread(len(trajectory.time))
        time, states = trajectory.time[rows], trajectory.states[rows]
        compare = _control_errors if error == "controls" else _cost_errors
        values = compare(trajectory, states, reference)
    return Curve(_positions(run, trajectory, time, against, unit), values)


def _positions(
    run: Converging, trajectory: Trajectory, time: np.ndarray, against: Against, unit: float | None
) -> np.ndarray:
    if against == "time":
        return time
    if against == "steps":
        if not isinstance(run, Run):
            raise NetworkError(
                "against: a trajectory or circuit has no steps; use 'time' or 'seconds'"
            )
        grid = np.linspace(0, run.steps, len(trajectory.residual_time))
        return np.interp(time, trajectory.residual_time, grid)
    own = run.deck.timing.unit if isinstance(run, CircuitRun) else unit
    if own is None:
        raise NetworkError(
            "against: only circuits have seconds; add the run of a circuit, or use 'time'"
        )
    return own * time


def _control_errors(
    trajectory: Trajectory, states: np.ndarray, reference: _Reference
) -> np.ndarray:
    """Return the largest errors (T,) of the controls, relative to their size."""
    wanted = reference.nearest
    assert wanted is not None
    end = control_values(wanted.network, wanted.final)
    found = control_values(trajectory.network, states)
    if found.shape[1:] != end.shape:
        raise NetworkError("error: its network has other controls than the optimum")
    return np.abs(found - end).max(axis=1) / size_of(end, wanted.control_reach)


def _cost_errors(trajectory: Trajectory, states: np.ndarray, reference: _Reference) -> np.ndarray:
    """Return the errors (T,) of the cost of states and controls, relative to the optimum's."""
    best = _solution(reference)
    costs = []
    for x in states:
        q, u, t = kkt_point(trajectory.network, x)[:3]
        costs.append(best.problem.functions.objective(np.column_stack([q, t[:, -1]]), u))
    return np.abs(np.array(costs) - best.objective) / max(abs(best.objective), LEAST)


def _solution(reference: _Reference) -> Solution:
    best = reference.solution
    if best is None:
        raise NetworkError(
            "error: the cost belongs to a problem; pass the certified solution as optimum="
        )
    if best.problem.objectives:
        raise NetworkError(
            "error: the cost of several objectives depends on their weights; use 'residual' or "
            "'controls'"
        )
    return best


def _of_levels(run: TwoLevelRun, against: Against, error: Error) -> Curve:
    if against != "steps" or error != "residual":
        raise NetworkError(
            "two levels have residuals over outer iterations; use against='steps' and "
            "error='residual'"
        )
    return Curve(np.arange(len(run.residuals), dtype=float), run.residuals[:, 0])


def _of_solver(run: SolverIterates, against: Against, error: Error, reference: _Reference) -> Curve:
    if against == "time" or error == "controls":
        raise NetworkError(
            "a digital solver has residuals and costs over iterations and seconds; use "
            "against='steps' or 'seconds', and error='residual' or 'objective'"
        )
    steps = np.arange(len(run.residuals), dtype=float)
    x = steps if against == "steps" else run.seconds * steps / max(steps[-1], 1.0)
    if error == "residual":
        return Curve(x, run.residuals)
    best = _solution(reference)
    off = np.abs(run.objectives - best.objective)
    return Curve(x, off / max(abs(best.objective), LEAST))


def _spread(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, POINTS)).astype(int))


@checked
def medians(categories: Mapping[str, Sequence[Curve]], centres: Mapping[str, Curve]) -> Figure:
    """Plot the residuals of a study over network time, with a colour for each category.

    ``centres`` are the medians by category; they have gaps where curves form two clusters.
    """
    figure = style.new_figure(8.6, 4.6)
    axes = figure.add_subplot()
    for colour, (name, curves) in zip(itertools.cycle(COLOURS), categories.items()):
        for curve in curves:
            axes.plot(*curve, color=colour, lw=0.8, alpha=0.3 if name in centres else 0.8)
        drawn = centres.get(name, Curve(np.empty(0), np.empty(0)))
        axes.plot(*drawn, color=colour, lw=2.2, label=name or "median")
    axes.set_yscale("log")
    axes.set_xlim(left=0.0)
    axes.set_xlabel(LABELS["time"])
    axes.set_ylabel(ERRORS["residual"])
    style.quiet(axes)
    style.legend_beside(axes)
    return figure


# ---- drawing -------------------------------------------------------------------------------------


def _drawn(
    curves: Mapping[str, Curve], runs: Mapping[str, Converging], against: Against, error: Error
) -> Figure:
    figure = style.new_figure(8.6, 4.6)
    axes = figure.add_subplot()
    looks = itertools.product(DASHES, COLOURS)
    for (name, curve), (dash, colour) in zip(curves.items(), itertools.cycle(looks)):
        values = style.drawable(np.maximum(curve.error, LEAST))
        axes.plot(curve.x, values, dash, color=colour, lw=1.5, label=name)
        if error == "residual":
            _mark(axes, runs[name], curve, colour)
    axes.set_yscale("log")
    ends = [curve.x[-1] for curve in curves.values() if curve.x[-1] > 0]
    is_wide = max(ends, default=1.0) > WIDE * min(ends, default=1.0)
    if is_wide:
        axes.set_xscale("log")
    else:
        axes.set_xlim(left=0.0)
    if error == "residual":
        for tolerance in {r.tolerance for r in runs.values() if isinstance(r, (Run, TwoLevelRun))}:
            axes.axhline(
                tolerance,
                color=INK,
                lw=0.8,
                ls=(0, (6, 4)),
                zorder=1,
                label=f"tolerance {tolerance:g}",
            )
    axes.set_xlabel(LABELS[against])
    axes.set_ylabel(ERRORS[error])
    style.quiet(axes)
    style.legend_beside(axes)
    return figure


def _mark(axes: Axes, run: Converging, curve: Curve, colour: str) -> None:
    """Mark the settling time of a run, or the outer iteration from which two levels are settled."""
    if isinstance(run, Run):
        at = np.interp(run.settling_time, run.trajectory.residual_time, curve.x)
    elif isinstance(run, TwoLevelRun):
        at = float(run.outer_iterations[0])
        at = at if at >= 0 else np.nan
    else:
        return
    if np.isfinite(at):
        axes.plot(at, run.tolerance, "o", ms=5, color=colour, mfc="white")
