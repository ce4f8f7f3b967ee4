"""How settling depends on rho and on each population's time constant, and where it ceases.

The question: are the designed gains the best ones, how much does it cost to miss them, and does the
spectrum know all that before a run?
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.metrics import METRICS, Metric
from ann_dc.study.sample import Sample
from ann_dc.study.settings import subject_of
from ann_dc.study.study import Study
from ann_dc.study.table import Table

FACTORS = tuple(10 ** (k / 3) for k in range(-6, 7))
"""On a gain: four decades."""
TOLERANCE = 1e-6
"""Of a run where the setting says nothing."""
BY_SPECTRUM = "settling_by_spectrum"


def settling_by_spectrum(sample: Sample) -> float:
    """ln(1 / tolerance) times radius / |abscissa| at the equilibrium near the designed point."""
    tolerance = float(sample.setting.get("run.tolerance", TOLERANCE))  # type: ignore[arg-type]
    return math.log(1 / tolerance) * sample.resting.ratio


MEASURED = (
    METRICS["settling_in_fastest"],
    Metric(
        name=BY_SPECTRUM,
        unit="fastest time constants",
        definition=" ".join((settling_by_spectrum.__doc__ or "").split()),
        value=settling_by_spectrum,
    ),
    METRICS["resting_decay_rate"],
)


def gain_names(subject: str | OptimalControlProblem | Network) -> tuple[str, ...]:
    """rho, and the time constant of every population of a network.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network

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
    kind: str = "pyramid",
    factors: Sequence[float] = FACTORS,
    gains: Sequence[str] | None = None,
) -> dict[str, Study]:
    """A study for every gain, which is multiplied by factors while the others stay as designed.

    Times are in fastest time constants of each network, so that a gain which makes one neuron
    faster than all hardware is charged for it.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        A network keeps its metric, whatever ``kind`` says.
    kind : str
        Metric of the design, a word of 'design.kind'.
    factors : sequence of float
        Positive, in ascending order.
    gains : sequence of str, optional
        Which ones, `gain_names` by default.

    Returns
    -------
    dict of str to Study
        By the name of the gain. Measured: settling, the same by the spectrum, and the rate at which
        the optimum attracts, negative where it repels.

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
            over={f"gains.{gain}": list(factors)},
            fixed={} if is_network else {"design.kind": kind},
            metrics=MEASURED,
            title=f"Settling against {gain}",
        )
        for gain in (gain_names(subject) if gains is None else gains)
    }


def boundaries(table: Table, gain: str) -> tuple[float, ...]:
    """Factors on a gain at which the optimum begins or ceases to attract, by the spectrum.

    Between two factors the rate is interpolated over the logarithm of the factor.

    Parameters
    ----------
    table : Table
        Of one study of `settling_against_gains`.
    gain : str

    Returns
    -------
    tuple of float
        Empty where the optimum attracts, or repels, throughout.

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
