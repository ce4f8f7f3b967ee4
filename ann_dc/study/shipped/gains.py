"""Settling against rho and each population's time constant, with stability limits.

The study tests whether the designed gains are optimal, how much a deviation costs, and whether the
spectrum predicts both before a run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.metrics import METRICS, Metric, definition_of
from ann_dc.study.sample import Sample
from ann_dc.study.settings import subject_of
from ann_dc.study.study import Study
from ann_dc.study.table import Table

FACTORS = tuple(10 ** (k / 3) for k in range(-6, 7))
"""Factors on a gain, over four decades."""
TOLERANCE = 1e-6
"""Default residual tolerance of a run."""
BY_SPECTRUM = "settling_by_spectrum"


def settling_by_spectrum(sample: Sample) -> float:
    """Return ln(1 / tolerance) times radius / |abscissa| at the designed equilibrium.

    The equilibrium is that near the designed point.
    """
    tolerance = float(sample.setting.get("run.tolerance", TOLERANCE))  # type: ignore[arg-type]
    return math.log(1 / tolerance) * sample.resting.stiffness_ratio


MEASURED = (
    METRICS["normalised_settling_time"],
    Metric(
        name=BY_SPECTRUM,
        unit="fastest time constants",
        definition=definition_of(settling_by_spectrum),
        value=settling_by_spectrum,
    ),
    METRICS["resting_decay_rate"],
)


def gain_names(subject: str | OptimalControlProblem | Network) -> tuple[str, ...]:
    """Return 'rho' and the time constant of every population of a network.

    Examples
    --------
    >>> gain_names("double_integrator")
    ('rho', 'tau.q', 'tau.u', 'tau.t', 'tau.mu', 'tau.beta')
    """
    neurons = subject_of(subject).wired.cell.neurons
    return ("rho", *dict.fromkeys(f"tau.{neuron.population}" for neuron in neurons))


def settling_against_gains(
    subject: str | OptimalControlProblem | Network,
    *,
    kind: str = "multilevel",
    factors: Sequence[float] = FACTORS,
    gains: Sequence[str] | None = None,
) -> dict[str, Study]:
    """Declare one study per gain, which factors multiply while others stay fixed.

    Times are in fastest time constants (1 / spectral radius) of each network. A gain that makes one
    neuron faster than the hardware therefore does not appear as an improvement.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network. A network retains its preconditioner regardless of `kind`.
    kind : str
        Preconditioner kind, a value of 'design.kind'. Default "multilevel" (additive multilevel).
    factors : sequence of float
        Positive factors in ascending order. Default: 0.01 to 100.
    gains : sequence of str, optional
        Gains to vary. By default all of `gain_names`.

    Returns
    -------
    dict of str to Study
        Studies by gain. Metrics: settling, its prediction by the spectrum, and the decay rate at
        the optimum, negative if it is unstable.

    Examples
    --------
    >>> study = settling_against_gains("car", factors=[0.5, 1.0, 2.0])["tau.mu"]
    >>> len(study), study.columns[2:4]
    (3, ('design.kind', 'gains.tau.mu'))
    """
    is_network = isinstance(subject, Network)
    return {
        gain: Study(
            subject=subject,
            vary={f"gains.{gain}": list(factors)},
            fixed={} if is_network else {"design.kind": kind},
            metrics=MEASURED,
            title=f"Settling against {gain}",
        )
        for gain in (gain_names(subject) if gains is None else gains)
    }


def boundaries(table: Table, gain: str) -> tuple[float, ...]:
    """Return the factors on a gain at which the stability of the optimum changes.

    Stability is given by the spectrum. The decay rate is interpolated over the logarithm of the
    factor.

    Parameters
    ----------
    table : Table
        Result of one study of `settling_against_gains`.
    gain : str
        Name of the gain.

    Returns
    -------
    tuple of float
        Empty if the optimum is stable, or unstable, for all factors.

    Examples
    --------
    >>> rates = np.array([-1.0, 1.0, 2.0])
    >>> columns = {"gains.rho": np.array([0.01, 1.0, 100.0]), "resting_decay_rate": rates}
    >>> [round(edge, 3) for edge in boundaries(Table(columns=columns, spec={}), "rho")]
    [0.1]
    """
    factors, rates = np.log(table[f"gains.{gain}"]), table["resting_decay_rate"]
    found = []
    for (low, before), (high, after) in pairwise(zip(factors, rates)):
        if before * after < 0:
            found.append(math.exp(low + (high - low) * before / (before - after)))
    return tuple(found)
