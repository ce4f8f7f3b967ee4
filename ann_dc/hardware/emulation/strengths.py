"""How strong a defect is: one number for all, a draw for each, or a resistor of a series."""

from __future__ import annotations

import math

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.e_series import Series
from ann_dc.network.network import Network
from ann_dc.network.selection import Known


def errors_of(network: Network, field: str, size: float, known: Known, seed: int | None) -> dict:
    """Errors of all that is known, so that draws do not depend on what is chosen of it.

    Parameters
    ----------
    network : Network
    field : str
        What a refusal calls the size.
    size : float
        Of every error; of one standard deviation with a seed.
    known : names
        Of neurons, blocks or connections.
    seed : int or None

    Returns
    -------
    dict of str to float or (N,) array

    Raises
    ------
    NetworkError
        If the size is not finite.
    """
    if not math.isfinite(size):
        raise NetworkError(f"{field}: expected a finite number, got {size!r}")
    if seed is None:
        return dict.fromkeys(known, size)
    draws = np.random.default_rng(seed).standard_normal((len(known), network.stages))
    return dict(zip(known, size * draws))


def require_strength(field: str, value: float) -> None:
    """Refuse a ``value`` that is not above zero; infinite means no defect.

    Raises
    ------
    NetworkError
        Naming the ``field``.
    """
    if not value > 0:
        raise NetworkError(f"{field}: expected a positive number, inf for no defect, got {value!r}")


def preferred(weight: np.ndarray, series: Series) -> np.ndarray:
    """Each ``weight`` as the nearest resistor of a ``series`` makes it, in units of 1 / ohm."""
    ohms = np.divide(1.0, np.abs(weight), out=np.full(weight.shape, np.inf), where=weight != 0)
    nearest = series.nearest(ohms)
    had = np.isclose(nearest, ohms, rtol=1e-12, atol=0.0)
    return np.where(had, weight, np.sign(weight) / nearest)
