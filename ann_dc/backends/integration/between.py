r"""States inside a step: compiled continuous extension of an explicit pair.

.. math:: x(s + \theta h) = x + h \sum_j b_j(\theta) K_j,

where the weights b_j are polynomials. A method of high order adds stages to those of the step; they
are evaluated only in steps in which a state is requested. States never exceed the saturation
limits. If a neuron reaches its limit in a step, slopes are not smooth, and the extension is only as
accurate as the error estimate of that step, whatever its order. For x'' = -4 x' - 100 x at the
relative tolerance 1e-6, states between steps are within 6.4e-7 of the closed form, relative to the
largest state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.integration.systems import combined, kept, residuals, slope
from ann_dc.backends.integration.tableaus import Extension
from ann_dc.evaluation.formulas import compiled, inlined

CHECKS = 4
"""Number of parts of a step at whose ends the residual is evaluated."""
ROUNDS, CLOSE = 20, 1e-5
"""Largest number of iterations to a crossing; final distance relative to the tolerance."""


class Aside(NamedTuple):
    """Continuous extension of the last step of a course."""

    starts: np.ndarray  # starts of `Extension`
    which: np.ndarray  # entries of `Extension`
    weights: np.ndarray  # weights of `Extension`; the last row is that of the requested state
    powers: np.ndarray  # powers of `Extension`
    x: np.ndarray  # state of the course before the step
    ahead: np.ndarray  # state inside the step
    slopes: np.ndarray  # slopes of the step, of E extra stages and of the state inside
    offsets: np.ndarray  # beginning of the slope of every entry, (entries,)
    scales: np.ndarray  # scales of the course

    @classmethod
    def of(
        cls, extension: Extension, x: np.ndarray, slopes: np.ndarray, scales: np.ndarray
    ) -> Aside:
        """Return the record for the arrays of a course."""
        starts, which, weights, powers = extension
        return cls(
            starts=starts,
            which=which,
            weights=weights.copy(),
            powers=powers,
            x=x,
            ahead=x.copy(),
            slopes=slopes,
            offsets=which * slopes.shape[1],
            scales=scales,
        )


@inlined
def extended(system, aside, h):
    """Evaluate the slopes of the extra stages; return False if a function block fails."""
    extra = aside.starts.shape[0] - 2
    first = aside.slopes.shape[0] - 1 - extra
    for stage in range(extra):
        combined(system, aside, stage, aside, h)
        if not slope(system, aside.ahead, aside.slopes[first + stage]):
            return False
    return True


@inlined
def inside(system, aside, theta, h):
    """Write the state at a fraction theta of the step into ``aside.ahead``."""
    row = aside.starts.shape[0] - 2
    for i in range(aside.powers.shape[0]):
        weight = 0.0
        for power in range(aside.powers.shape[1] - 1, -1, -1):
            weight = (weight + aside.powers[i, power]) * theta
        aside.weights[aside.starts[row] + i] = weight
    combined(system, aside, row, aside, h)
    kept(system, aside.ahead)


@inlined
def _worst(system, aside, theta, h):
    """Return the larger residual inside the step; infinite if a function block fails."""
    inside(system, aside, theta, h)
    if not slope(system, aside.ahead, aside.slopes[-1]):
        return np.inf
    constraint, stationarity, _ = residuals(system, aside.ahead)
    return max(constraint, stationarity)


@compiled
def last_exit(system, aside, h, ends, tolerance):
    """Locate the fraction of a step at which a residual last falls below a tolerance.

    Returns ``theta``, negative if the residual stays below, and the number of evaluated right-hand
    sides. ``ends`` contains the residuals at both ends of the step of length ``h``.
    """
    before, low = ends
    checks = aside.starts.shape[0] - 2
    if not extended(system, aside, h):
        return (-1.0 if before < tolerance else 1.0), checks
    high, a, b = before, 0.0, 1.0
    for look in range(CHECKS - 1, 0, -1):
        worst, at = _worst(system, aside, look / CHECKS, h), look / CHECKS
        checks += 1
        if not worst < tolerance:
            high, a = worst, at
            break
        low, b = worst, at
    if high < tolerance:
        return -1.0, checks
    theta, more = _crossing(system, aside, h, (a, b), (high, low), tolerance)
    return theta, checks + more


@inlined
def _crossing(system, aside, h, between, ends, tolerance):
    """Find the crossing of the tolerance by false position of the residual logarithms."""
    (a, b), least = between, 1e-300
    high, low = np.log(ends[0] / tolerance), np.log(max(ends[1], least) / tolerance)
    theta, side = b, 0.0
    for count in range(ROUNDS):
        theta = b - low * (b - a) / (low - high) if high < np.inf else 0.5 * (a + b)
        found = np.log(max(_worst(system, aside, theta, h), least) / tolerance)
        if abs(found) < CLOSE:
            return theta, count + 1
        stays = 0.5 if side * found > 0.0 else 1.0  # Illinois: an end that stays twice counts half
        side = found
        if found < 0.0:
            b, low, high = theta, found, stays * high
        else:
            a, high, low = theta, found, stays * low
    return theta, ROUNDS
