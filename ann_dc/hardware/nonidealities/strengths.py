"""Strength of a non-ideality: constant, draw per element or rounded resistor."""

from __future__ import annotations

import math

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.e_series import Series
from ann_dc.network.network import Network
from ann_dc.network.selection import Known

WEIGHTS, TIME_CONSTANTS = (), (1,)
"""Random streams of one seed: the default stream, used for weights, and that of time constants."""


def errors_of(
    network: Network,
    field: str,
    size: float,
    known: Known,
    seed: int | None,
    of: tuple[int, ...] = WEIGHTS,
) -> dict:
    """Return the errors of all known names, as float or (N,) array.

    Errors cover all neurons, blocks or connections, so that draws do not depend on a selection. The
    size is the error of every element, or with a seed the standard deviation. ``of`` selects the
    random stream of the seed. Raises `NetworkError`, with ``field`` as the name, if the size is not
    finite.
    """
    require_finite(field, size)
    if seed is None:
        return dict.fromkeys(known, size)
    return dict(zip(known, size * draws(seed, (len(known), network.stages), of)))


def draws(seed: int, shape: tuple[int, int], of: tuple[int, ...] = WEIGHTS) -> np.ndarray:
    """Return normal draws of a stream of a seed."""
    stream = np.random.SeedSequence(seed, spawn_key=of)
    return np.random.default_rng(stream).standard_normal(shape)


def require_finite(field: str, value: float) -> None:
    """Raise `NetworkError`, with the name ``field``, if ``value`` is not finite."""
    if not math.isfinite(value):
        raise NetworkError(f"{field}: expected a finite number, got {value!r}")


def require_strength(field: str, value: float) -> None:
    """Raise `NetworkError`, with the name ``field``, if ``value`` is not positive.

    An infinite value disables the non-ideality.
    """
    if not value > 0:
        raise NetworkError(f"{field}: expected a positive number, inf for no defect, got {value!r}")


def preferred(weight: np.ndarray, series: Series) -> np.ndarray:
    """Return weights, in 1 / ohm, as made by the nearest resistors of a ``series``."""
    ohms = np.divide(1.0, np.abs(weight), out=np.full(weight.shape, np.inf), where=weight != 0)
    nearest = series.nearest(ohms)
    had = np.isclose(nearest, ohms, rtol=1e-12, atol=0.0)
    return np.where(had, weight, np.sign(weight) / nearest)
