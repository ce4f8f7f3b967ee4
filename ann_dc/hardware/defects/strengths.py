"""How strong a defect is: one number for all, a draw for each, or a resistor of a series."""

from __future__ import annotations

import math

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.e_series import Series
from ann_dc.network.network import Network
from ann_dc.network.selection import Known

WEIGHTS, TIME_CONSTANTS = (), (1,)
"""Streams of draws of one seed: those of weights and of all else, and those of time constants."""


def errors_of(
    network: Network,
    field: str,
    size: float,
    known: Known,
    seed: int | None,
    of: tuple[int, ...] = WEIGHTS,
) -> dict:
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
    of : tuple of int
        Which stream of the seed.

    Returns
    -------
    dict of str to float or (N,) array

    Raises
    ------
    NetworkError
        If the size is not finite.
    """
    require_finite(field, size)
    if seed is None:
        return dict.fromkeys(known, size)
    return dict(zip(known, size * draws(seed, (len(known), network.stages), of)))


def draws(seed: int, shape: tuple[int, int], of: tuple[int, ...] = WEIGHTS) -> np.ndarray:
    """Normal draws of a stream of a seed, in an array of that shape."""
    stream = np.random.SeedSequence(seed, spawn_key=of)
    return np.random.default_rng(stream).standard_normal(shape)


def require_finite(field: str, value: float) -> None:
    """Refuse a ``value`` that is no finite number.

    Raises
    ------
    NetworkError
        Naming the ``field``.
    """
    if not math.isfinite(value):
        raise NetworkError(f"{field}: expected a finite number, got {value!r}")


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
