r"""Modes of a linear flow: decay of a deviation and response to a forcing term.

.. math:: \dot y = J y + n(t), \qquad
    y_i(t + h) = e^{\lambda_i h} y_i(t) + \int_0^h e^{\lambda_i (h - s)} n_i(t + s)\, ds ,

where n is linear between the times at which it is known, so that the integral is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

WORST_CONDITION = 1e10
"""Largest condition of eigenvectors that separate the modes: half of the digits are lost."""
SMALL = 1e-2
"""|lambda h| below which an integral is summed as a series; the next term is rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """Eigenvalues and vectors of a flow J (n, n), one per complex pair.

    The eigenvalue of a pair counts twice.

    Attributes
    ----------
    values : (m,) complex array
        Eigenvalues in units of 1 / network time.
    right, left : (n, m) and (m, n) complex arrays
        A deviation is the real part of ``right`` times the amplitudes; ``left`` times a deviation
        gives the amplitudes.
    condition : float
        Condition of all eigenvectors; infinite if there are too few.

    Examples
    --------
    >>> modes = Modes.of(np.array([[-1.0, 1.0], [0.0, -3.0]]))
    >>> modes.at([0.0, 2.0], np.array([0.0])).round(12).tolist() == [[0.0], [2.0]]
    True
    """

    values: np.ndarray
    right: np.ndarray
    left: np.ndarray
    condition: float

    @classmethod
    def of(cls, flow: np.ndarray) -> Modes:
        """Compute the modes of a dense flow (n, n)."""
        values, right = np.linalg.eig(flow)
        try:
            left = np.linalg.inv(right)
            condition = float(np.linalg.norm(left) * np.linalg.norm(right))
        except np.linalg.LinAlgError:
            left, condition = np.zeros_like(right), np.inf
        one = np.imag(values) >= 0
        twice = np.where(np.imag(values) > 0, 2.0, 1.0)[one]
        return cls(
            values=values[one].astype(complex),
            right=right[:, one] * twice,
            left=left[one],
            condition=condition,
        )

    @property
    def slowest(self) -> float:
        """Rate of the slowest mode; zero or less if the flow does not settle."""
        return float(-np.real(self.values).max(initial=-np.inf))

    def at(self, deviation: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the deviations (n, T) at some times, from one (n,) at time zero."""
        return self.deviations(self.decay(self.amplitudes(np.asarray(deviation)), times))

    def amplitudes(self, deviations: np.ndarray) -> np.ndarray:
        """Return the amplitudes (m, ...) of real deviations (n, ...)."""
        return np.real(self.left) @ deviations + 1j * (np.imag(self.left) @ deviations)

    def decay(self, amplitudes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the amplitudes (m, T) after some times, from those (m,) at time zero."""
        return amplitudes[:, None] * np.exp(np.multiply.outer(self.values, times))

    def deviations(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the real deviations (n, ...) of amplitudes (m, ...)."""
        real, imaginary = np.real(amplitudes), np.imag(amplitudes)
        return np.real(self.right) @ real - np.imag(self.right) @ imaginary

    def steps(self, lengths: np.ndarray) -> Steps:
        """Return the weights of steps of lengths (T,) with a forcing term linear in time."""
        z = np.multiply.outer(self.values, lengths)
        factor = np.exp(z)
        series, safe = np.abs(z) < SMALL, np.where(np.abs(z) < SMALL, 1.0, z)
        first = np.where(series, 1 + z / 2 + z**2 / 6 + z**3 / 24, (factor - 1) / safe)
        second = np.where(series, 0.5 + z / 6 + z**2 / 24, (first - 1) / safe)
        return Steps(decay=factor, constant=lengths * first, slope=lengths * second)


class Steps(NamedTuple):
    """Weights (m, T) of steps: ``decay * a + constant * n + slope * (n_end - n)``."""

    decay: np.ndarray
    """Weight of the amplitudes a at the beginning of a step."""
    constant: np.ndarray
    """Weight of the amplitudes n of the forcing term at the beginning."""
    slope: np.ndarray
    """Weight of the increase of the forcing term at the end."""
