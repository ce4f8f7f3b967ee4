"""Figures 4 and 5: paths in the plane and their controls, without obstacles and among them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from ann_dc.paper.around import APART, RADIUS, Around, Piece, obstacles, whole
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, SKY, VERMILION
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solution.solution import Solution
from ann_dc.validation import Finite, NotEmpty, OrNan, Positive, Shape, checked

OBSTACLE = "#D9D9D9"


@checked
@dataclass(frozen=True, kw_only=True)
class Disc:
    """Disc obstacle: centre `x`, `y` and `radius`, in the unit of the axes."""

    x: Finite
    y: Finite
    radius: Positive


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """Path, or controls over the stages, with drawing style.

    Attributes
    ----------
    name : str
        Legend entry.
    rows : (R, K) array
        x and y at K nodes, or R controls at K stages.
    dashed : bool
        True for a thin dashed line without dots, for example a simulated path.
    """

    name: str
    rows: Annotated[np.ndarray, Shape("R", "K"), OrNan()]
    colour: str = BLUE
    dashed: bool = False

    def line(self) -> dict[str, Any]:
        """Return the options of ``Axes.plot``."""
        if self.dashed:
            return {"color": self.colour, "lw": 1.1, "ls": "--", "zorder": 4, "label": self.name}
        return {"color": self.colour, "lw": 1.6, "marker": "o", "ms": 4, "label": self.name}


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Content of one panel; `discs` are its obstacles."""

    heading: str
    drawn: Sequence[Drawn]
    discs: Sequence[Disc] = ()


@checked
def plane(
    panels: Annotated[Sequence[Panel], NotEmpty()],
    *,
    start: tuple[float, float],
    target: tuple[float, float],
    unit: str = "m",
    title: str = "",
    columns: int | None = None,
) -> Figure:
    """Plot paths from a start to a target in panels (Figure 4 of the paper).

    The rows of the panels are x and y, in `unit`. By default all panels are in one row of
    `columns`.

    Examples
    --------
    >>> path = Drawn(name="T_0", rows=np.array([[0.0, 2.0, 5.0], [0.0, 3.0, 5.0]]))
    >>> panel = Panel(heading="around", drawn=[path], discs=[Disc(x=3.0, y=3.0, radius=0.5)])
    >>> len(plane([panel], start=(0.0, 0.0), target=(5.0, 5.0)).axes)
    1
    """
    columns = columns or len(panels)
    rows = -(-len(panels) // columns)
    figure = style.new_figure(0.6 + 4.0 * columns, 0.4 + 4.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, panel in zip(grid.flat, panels):
        _draw(axes, panel)
        style.mark_ends(axes, start, target)
        axes.set_title(panel.heading, fontsize=9, loc="left", color=INK)
        axes.set_aspect("equal")
        style.quiet(axes)
    for axes in grid[-1]:
        axes.set_xlabel(style.with_unit("x", unit))
    for axes in grid[:, 0]:
        axes.set_ylabel(style.with_unit("y", unit))
    style.headline(figure, title)
    style.legend_below(figure, most=3)
    return figure


def _draw(axes: Axes, panel: Panel) -> None:
    for number, disc in enumerate(panel.discs):
        shape = Circle((disc.x, disc.y), disc.radius, fc=OBSTACLE, ec=GREY, lw=0.8, zorder=1)
        shape.set_label("obstacle" if number == 0 else "_nolegend_")
        axes.add_patch(shape)
    for path in panel.drawn:
        axes.plot(*style.drawable(path.rows), **path.line())


@checked
def controls_over_stages(
    panels: Annotated[Sequence[Panel], NotEmpty()],
    *,
    labels: Annotated[Sequence[str], NotEmpty()],
    title: str = "",
    columns: int | None = None,
) -> Figure:
    """Plot every control over the stages, one column per panel (paper, Figure 5).

    The rows of the panels are the controls and `labels` are their names with units. By default all
    panels are in one row. A column whose range far exceeds that of the first shows three times that
    range and is cut off outside.
    """
    columns, m = columns or len(panels), len(labels)
    rows = m * -(-len(panels) // columns)
    figure = style.new_figure(0.6 + 4.4 * columns, 1.4 + 2.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharex="col")
    for number, panel in enumerate(panels):
        block, place = divmod(number, columns)
        column = grid[m * block : m * (block + 1), place]
        for row, (axes, label) in enumerate(zip(column, labels)):
            for drawn in panel.drawn:
                _held(axes, style.drawable(drawn.rows[row]), drawn.line())
            axes.set_ylabel(label)
            style.quiet(axes)
        column[0].set_title(panel.heading, fontsize=9, loc="left", color=INK)
    for axes in grid[-1]:
        axes.set_xlabel("stage k")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes, others in zip(grid[:, 0], grid[:, 1:]):
        low, high = axes.get_ylim()
        for other in others:
            own, most = other.get_ylim(), 2 * (high - low)
            if own[0] < low - most or own[1] > high + most:
                other.set_ylim(2 * low - high, 2 * high - low)
    style.headline(figure, title)
    style.legend_below(figure, most=3)
    return figure


def _held(axes: Axes, values: np.ndarray, line: dict[str, Any]) -> None:
    """Plot values (N,) over the stages, piecewise constant."""
    stages = np.arange(len(values) + 1)
    line = {key: line[key] for key in ("color", "lw", "ls", "label", "zorder") if key in line}
    axes.plot(stages, np.append(values, values[-1]), drawstyle="steps-post", **line)


def _control_labels(problem: OptimalControlProblem) -> list[str]:
    return [
        style.with_unit(f"u_{i} = {u}", problem.unit(str(u)))
        for i, u in enumerate(problem.controls, 1)
    ]


# ---- without obstacles

HOLDS, PRINTED = "corrected equations", "printed equations"
LED = "simulation with its controls"
FADING = (SKY, ORANGE, GREY)
REACH = 1.6
"""Limit of x and y, relative to the largest target component, up to which a diverging run is drawn.
"""

Named = tuple[str, Piece, str, bool]
"""Legend entry, path, its colour, and True if it is the simulated path of the controls."""


@checked
def free_paths(optimum: Solution, straight: Solution, letter: Solution) -> Figure:
    """Plot the path without obstacles next to two paths of the printed equations.

    Parameters
    ----------
    optimum : Solution
        Solution of the corrected equations.
    straight : Solution
        Solution without dB/dq (erratum S3).
    letter : Solution
        Run of (16) and (17) as printed.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import ann_dc
    >>> found = ann_dc.solve(ann_dc.plants.car())
    >>> len(free_paths(found, found, found).axes)
    2

    References
    ----------
    Paper, Figure 4.
    """
    problem = optimum.problem
    names = [str(s) for s in problem.states]
    places = [names.index("x"), names.index("y")]
    (x_0, y_0), (x_d, y_d) = (end[places].tolist() for end in problem.ends)
    panels = zip((HOLDS, PRINTED), _free(optimum, straight, letter))
    return plane(
        [Panel(heading=name, drawn=_drawn(paths, "q")) for name, paths in panels],
        start=(x_0, y_0),
        target=(x_d, y_d),
        unit=problem.unit("x"),
        title=f"Paths without obstacles, {style.caption(problem)}",
    )


@checked
def free_controls(optimum: Solution, straight: Solution, letter: Solution) -> Figure:
    """Plot the controls of the paths in `free_paths`.

    Parameters
    ----------
    optimum, straight, letter : Solution
        Solutions as in `free_paths`.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import ann_dc
    >>> found = ann_dc.solve(ann_dc.plants.car())
    >>> len(free_controls(found, found, found).axes)
    4

    References
    ----------
    Paper, Figure 5.
    """
    holds, printed = _free(optimum, straight, letter)
    chosen = {HOLDS: holds[:1], PRINTED: [path for path in printed if not path[-1]]}
    return controls_over_stages(
        [Panel(heading=name, drawn=_drawn(paths, "u")) for name, paths in chosen.items()],
        labels=_control_labels(optimum.problem),
        title=f"Controls without obstacles, {style.caption(optimum.problem)}",
    )


def _free(
    optimum: Solution, straight: Solution, letter: Solution
) -> tuple[list[Named], list[Named]]:
    """Return the paths of the corrected and of the printed equations."""
    holds = [
        ("T_0, the optimum", path_of(optimum), BLUE, False),
        (LED, rolled_out(optimum), INK, True),
    ]
    printed = [
        ("without dB/dq (S3)", path_of(straight), VERMILION, False),
        (LED, rolled_out(straight), INK, True),
    ]
    away = zip(run_away(letter).items(), FADING)
    printed += [(f"(16), (17) {name}", path, colour, False) for (name, path), colour in away]
    return holds, printed


def _drawn(paths: Iterable[Named], field: str) -> list[Drawn]:
    """Return the positions (`field` q) or the controls (u) of paths."""
    return [
        Drawn(name=name, rows=getattr(path, field), colour=colour, dashed=dashed)
        for name, path, colour, dashed in paths
    ]


def path_of(solution: Solution, sample: int = -1) -> Piece:
    """Return x and y of the q neurons at a sample of the run, followed by t_{N-1}."""
    run, controls = solution.trajectory, map(str, solution.problem.controls)
    q = [np.append(run[f"q.{s}"][sample], run[f"t.{s}"][sample, -1]) for s in ("x", "y")]
    return Piece(np.stack(q), np.stack([run[f"u.{u}"][sample] for u in controls]))


def rolled_out(solution: Solution) -> Piece:
    """Return x and y of the simulated path of the final controls."""
    states = [str(s) for s in solution.problem.states]
    places = [states.index("x"), states.index("y")]
    return Piece(solution.certificate.rollout[places], solution.populations["u"].T)


def run_away(solution: Solution, count: int = 3) -> dict[str, Piece]:
    """Return moments of a diverging run within the figure, named by network time."""
    run, ends = solution.trajectory, [v or 0.0 for v in solution.problem.q_d or ()]
    largest = REACH * max(map(abs, ends))
    size = np.maximum(*(np.abs(run[f"q.{s}"]).max(axis=1) for s in ("x", "y")))
    inside = int(np.argmax(~(size < largest))) or len(size)
    moments = np.linspace(0, inside - 1, count + 1).astype(int)[1:]
    return {f"after {run.time[k]:.2g} time constants": path_of(solution, int(k)) for k in moments}


# ---- among obstacles

COLUMNS = 3
"""Panels of a case: as printed, with segments (legs), with discs."""
FREE = "T_0, planned without obstacles"
PLANNED = "T_0, T_1, ... (executed parts, IV.C)"
LEAP = "to q_obs + delta (printed without a plan)"
SEGMENT = "segments to q_obs + delta, planned"
DRIVEN = "executed plans and segments"
CONSTRAINED = "one network, obstacles as constraints"


@checked
def figure_4(cases: Sequence[Around]) -> Figure:
    """Plot the paths among obstacles: as printed, with segments, and with discs.

    See Figure 4 and section IV.C of the paper.

    Examples
    --------
    >>> from ann_dc.paper import around, iterations
    >>> cases = [around(plans, problem) for plans in iterations().cases]  # doctest: +SKIP
    >>> figure = figure_4(cases)  # doctest: +SKIP
    """
    problem = cases[0].discs.problem
    (x_0, y_0), (x_d, y_d) = (end[:2].tolist() for end in problem.ends)
    return plane(
        [panel for case in cases for panel in _panels(case, _paths(case))],
        start=(x_0, y_0),
        target=(x_d, y_d),
        unit=problem.unit("x"),
        title=f"Figure 4. Paths among obstacles of radius {RADIUS:g} m; clearance: distance "
        "from a segment to an edge; constraints keep nodes and intermediate points "
        f"{APART:g} m from centres",
        columns=COLUMNS,
    )


@checked
def figure_5(cases: Sequence[Around]) -> Figure:
    """Plot the controls of the paths in `figure_4` (Figure 5 of the paper).

    Examples
    --------
    >>> from ann_dc.paper import around, iterations
    >>> cases = [around(plans, problem) for plans in iterations().cases]  # doctest: +SKIP
    >>> figure = figure_5(cases)  # doctest: +SKIP
    """
    problem = cases[0].discs.problem
    return controls_over_stages(
        [panel for case in cases for panel in _panels(case, _controls(case))],
        labels=_control_labels(problem),
        title=f"Figure 5. Controls of the paths of Figure 4, stages of {problem.dt:g} s",
        columns=COLUMNS,
    )


def _panels(case: Around, drawn: Sequence[Sequence[Drawn]]) -> list[Panel]:
    """Return the panels of a case: as printed, with segments, with discs."""
    name, certificate = case.plans.case.name, case.discs.certificate
    reported = "certified" if case.discs.certified else "not certified"
    segments, constrained = (f"clearance {case.room(way):.3f} m" for way in case.ways.values())
    headings = (
        f"{name}, as printed\n{case.leap:.2f} m of the path without a plan",
        f"{name}, segments planned\n{segments}",
        f"{name}, as constraints\n{constrained}, E = {certificate.objective:.2f}, {reported}",
    )
    discs = [Disc(x=float(x), y=float(y), radius=RADIUS) for x, y in obstacles(case.plans)]
    return [Panel(heading=h, drawn=d, discs=discs) for h, d in zip(headings, drawn)]


def _paths(case: Around) -> tuple[Sequence[Drawn], ...]:
    free = Drawn(name=FREE, rows=case.plans.states[0, :2], colour=INK, dashed=True)
    pieces = [piece.q[:2] for piece in case.printed]
    planned = Drawn(name=PLANNED, rows=_apart(pieces), colour=BLUE)
    leaps = [np.stack([a[:, -1], b[:, 0]], axis=1) for a, b in pairwise(pieces)]
    leap = Drawn(name=LEAP, rows=_apart(leaps), colour=VERMILION, dashed=True)
    segments = [whole(segment).q[:2] for segment in case.segments]
    return (
        (free, planned, leap),
        (free, planned, Drawn(name=SEGMENT, rows=_apart(segments), colour=ORANGE)),
        (free, Drawn(name=CONSTRAINED, rows=case.ways["discs"].q[:2], colour=GREEN)),
    )


def _controls(case: Around) -> tuple[Sequence[Drawn], ...]:
    free = Drawn(name=FREE, rows=case.plans.controls[0], colour=INK, dashed=True)
    pieces = [piece.u for piece in case.printed]
    segments, constrained = case.ways.values()
    return (
        (free, Drawn(name=PLANNED, rows=_apart(pieces), colour=BLUE)),
        (free, Drawn(name=DRIVEN, rows=segments.u, colour=ORANGE)),
        (free, Drawn(name=CONSTRAINED, rows=constrained.u, colour=GREEN)),
    )


def _apart(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """Concatenate pieces (R, K) with gaps between them."""
    gap = np.full((len(pieces[0]), 1), np.nan)
    return np.hstack([part for piece in pieces for part in (piece, gap)][:-1])
