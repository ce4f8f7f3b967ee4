"""Figure 6, equation (21) and Theorem IV.1, from runs of the two-level algorithm."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ann_dc.errors import NetworkError
from ann_dc.paper.replans import SHARE, Iterations
from ann_dc.plotting.paper.iterations import (
    Curves,
    definitions,
    following,
    gain_over_iterations,
)
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION
from ann_dc.two_level.lyapunov import Lyapunov
from ann_dc.two_level.run import TwoLevelRun

COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE)
"""Colours of the plans T_0, T_1, ..."""
UNTOLD = "figures of the two levels: the run was not told the solution; pass settled="


def figure_6(found: Iterations) -> Figure:
    """Plot lambda, A, B and Theta of every plan in both cases, and as printed.

    Parameters
    ----------
    found : Iterations
        Result of `ann_dc.paper.iterations`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    NetworkError
        If a run does not contain the solution.

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> figure = figure_6(iterations())  # doctest: +SKIP

    References
    ----------
    Paper, Figure 6.
    """
    columns = {}
    for plans in found.cases:
        own = _known(plans.run)
        columns[plans.case.name] = [
            _curves(f"T_{m}", plans.run, own, m, colour)
            for m, colour in zip(range(len(plans.starts)), COLOURS)
        ]
    columns["what settles: T_0"] = [
        _curves(f"two gains (λ of t): {_needed(found.gradient)}", found.gradient, None, 0, SKY),
        _curves(f"Newton's method: {_needed(found.newton)}", found.newton, None, 0, PURPLE),
    ]
    letter = found.letter
    columns["(28)-(30), (33) as printed"] = [
        _curves("T_0 as printed, A and B as they are", letter, _known(letter), 0, INK),
        _curves("T_0 as printed, A and B of (20), (21)", letter, letter.printed_lyapunov, 0, GREY),
    ]
    ends = np.concatenate([plans.run.outer_iterations for plans in found.cases])
    settled = f"{(ends >= 0).sum()} of {len(ends)} plans settle"
    return gain_over_iterations(
        columns,
        title=f"Figure 6. λ = {SHARE:g} |B/A| (33), with which {settled}; gains and steps that "
        "settle; (28)-(30) as printed",
    )


def figure_of_definitions(found: Iterations) -> Figure:
    """Plot A and B for one fixed gain of t and beta, corrected and as printed.

    The printed definitions are (20) and (21).

    Parameters
    ----------
    found : Iterations
        Result of `ann_dc.paper.iterations`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    NetworkError
        If a run does not contain the solution.

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> figure = figure_of_definitions(iterations())  # doctest: +SKIP

    References
    ----------
    Paper equations (20), (21).
    """
    run = found.common
    return definitions(
        [
            _curves("corrected", run, _known(run), 0, BLUE),
            _curves("as (20), (21) print them", run, run.printed_lyapunov, 0, VERMILION),
        ],
        title="A and B of (21), T_0 with one fixed gain for t and beta, started near the solution",
    )


def figure_of_following(found: Iterations) -> Figure:
    """Plot the measurement of Theorem IV.1 in a run that settles with two fixed gains.

    Parameters
    ----------
    found : Iterations
        Result of `ann_dc.paper.iterations`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    NetworkError
        If a run does not contain the solution.

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> figure = figure_of_following(iterations())  # doctest: +SKIP

    References
    ----------
    Paper equation (18) and Theorem IV.1.
    """
    distances = found.gradient.distances
    if distances is None:
        raise NetworkError(UNTOLD)
    errors = {
        "e_v": (distances.v[:, 0], found.following.v),
        "e_mu": (distances.mu[:, 0], found.following.mu),
    }
    return following(
        distances.told[:, 0],
        errors,
        title="Theorem IV.1 measured, T_0 with two fixed gains; dotted: its bound to first order",
    )


def _needed(run: TwoLevelRun) -> str:
    return f"{run.outer_iterations[0]} outer iterations"


def _known(run: TwoLevelRun) -> Lyapunov:
    if run.lyapunov is None:
        raise NetworkError(UNTOLD)
    return run.lyapunov


def _curves(name: str, run: TwoLevelRun, of: Lyapunov | None, sample: int, colour: str) -> Curves:
    theta, A, B = (np.asarray(part)[: run.rounds, sample] for part in of or _known(run))
    gain = run.gains[:, 0, sample]
    return Curves(name=name, gain=gain, A=A, B=B, theta=theta, colour=colour)
