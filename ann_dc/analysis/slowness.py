r"""Diagnosis of slow settling: slowest modes, causes, and distance from the limit.

A mode e^{st} of the flow at a settled point has a primal part z and a dual part d. Its rate is

.. math::
    -\mathrm{Re}\, s = \frac{z^* H z + z^* A^T W A z}{z^* M^{-1} z + d^* K^{-1} d} ,

curvature and penalty divided by the energy of the mode in the preconditioner M^{-1}. In an
oscillatory mode, both parts have half of the energy. With the *exact* preconditioner M = (H +
A'WA)^{-1} and K = eta W every mode is s = -1 or

.. math:: s^2 + s + \eta \kappa = 0, \qquad \kappa = \frac{1}{1 + q/w} ,

where q/w is the inverse Schur complement (`saddle`) in units of the penalties. With the optimal eta
= 1 / (4 min kappa),

.. math:: \text{ratio} = \max\Big(2, \sqrt{\max\kappa / \min\kappa}\Big) .

A slow mode thus has three possible causes. The multipliers are more sensitive than the penalty (q >
w). The penalty is low for the curvature of the constraints (q < 0, w < rho*). The preconditioner
does not follow the mode. With 3 w >= max q - 4 min q and the exact preconditioner no cause remains:
the ratio is 2 for every problem.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.analysis.saddle import (
    MultiplierSensitivity,
    Saddle,
    multiplier_sensitivities,
    penalty_threshold,
    saddle_of,
)
from ann_dc.analysis.spectra import Spectrum, slowest_modes, spectrum
from ann_dc.errors import NetworkError
from ann_dc.network.network import Network
from ann_dc.validation import State, checked

LIMIT = 2.0
"""Stiffness ratio of the exact preconditioner, for every problem."""

MODES = 3
"""Number of slowest modes reported, if the network has as many."""

SHOWN = 3
"""Number of leading neurons of a mode that are reported."""

_DUAL_SHARE = 0.2
"""Fraction of energy of the duals below which a mode is purely primal."""

NOISE = 0.05
"""Fraction of a mode's largest value below which a sign is ignored."""


class Cause(enum.Enum):
    """Cause of a slow mode; the value is the sentence that is displayed."""

    REACH = "weakly reachable constraints: the multiplier sensitivity exceeds the penalty"
    CURVATURE = "the penalty is low for the curvature of the constraints"
    PRECONDITIONER = "the preconditioner does not couple the neurons that should change together"


@dataclass(frozen=True, kw_only=True, eq=False)
class Mode:
    """Mode of the flow at a settled point.

    Attributes
    ----------
    eigenvalue : complex
        s, of a pair the value with positive imaginary part; unit 1 / network time.
    names : tuple of str
        Names of the P neurons of the cell.
    shape : (P, N) array
        Values of every neuron over the stages at the phase of largest amplitude. Squares are
        fractions of energy; nan for omitted neurons.
    dual_share : float
        Fraction of the energy d'K^{-1}d.
    curvature, penalty : float
        Contributions of z'Hz and z'A'WAz to the rate -Re s.
    shadow : float
        q/w along the mode.
    """

    eigenvalue: complex
    names: tuple[str, ...]
    shape: np.ndarray
    dual_share: float
    curvature: float
    penalty: float
    sensitivity: float

    @property
    def rate(self) -> float:
        """Rate -Re s, in 1 / network time."""
        return -self.eigenvalue.real

    @property
    def oscillates(self) -> bool:
        """True if the mode belongs to a complex pair."""
        return abs(self.eigenvalue.imag) > 1e-9 * abs(self.eigenvalue)

    @property
    def shares(self) -> np.ndarray:
        """Fractions (P,) of the energy z*M^{-1}z + d*K^{-1}d, by neuron of the cell.

        With a preconditioner that couples neurons, a negative fraction is possible and counts as
        zero.
        """
        return np.nansum(self.shape**2, axis=1)

    @property
    def leading(self) -> tuple[str, ...]:
        """Neurons with at least half of the largest energy fraction, the largest first."""
        shares = self.shares
        order = np.argsort(-shares, kind="stable")
        return tuple(self.names[i] for i in order if shares[i] >= 0.5 * shares.max())

    @property
    def sign_changes(self) -> int:
        """Sign changes over the horizon of the neuron with the largest energy fraction."""
        values = self.shape[int(np.argmax(self.shares))]
        signs = np.sign(values[np.abs(values) > NOISE * np.nanmax(np.abs(values))])
        return int((signs[1:] != signs[:-1]).sum())

    @property
    def cause(self) -> Cause:
        """Cause of slowness; a preconditioner can tolerate q/w between -1/2 and 1."""
        if self.dual_share >= _DUAL_SHARE:
            if self.sensitivity > 1.0:
                return Cause.REACH
            if self.sensitivity < -0.5:
                return Cause.CURVATURE
        return Cause.PRECONDITIONER

    @property
    def pattern(self) -> str:
        """Number of sign changes over the horizon, as text."""
        count = self.sign_changes
        return "no sign change" if count == 0 else f"{count} sign change{'s' * (count > 1)}"

    def __str__(self) -> str:
        s, shares = self.eigenvalue, dict(zip(self.names, self.shares))
        reported = ", ".join(f"{name} {100 * shares[name]:.0f} %" for name in self.leading[:SHOWN])
        pair = f" +- {s.imag:.3g}i" if self.oscillates else ""
        return f"{s.real:.3g}{pair}: {reported}; {self.pattern}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Slowness:
    """Diagnosis of the settling speed of a network.

    Attributes
    ----------
    spectrum, modes : Spectrum and tuple of Mode
        Spectrum at the settled point, and its slowest modes, the slowest first.
    rows : tuple of RowShadow
        Inverse Schur complement and penalty of every constraint, in network units.
    lowest, highest : float
        Ends of the spectrum of q/w, over all constraints together.
    rho_star : float
        Common penalty above which H + rho A'A is positive definite.

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> designed = design(plants.double_integrator(N=5))
    >>> found = slowness_of(designed.network, designed.state)
    >>> [row.neuron for row in found.rows]
    ['mu.x', 'mu.v', 'beta.x', 'beta.v']
    >>> found.ratio == designed.spectrum.stiffness_ratio, found.exact_ratio() >= LIMIT
    (True, True)
    """

    spectrum: Spectrum
    rows: tuple[MultiplierSensitivity, ...]
    lowest: float
    highest: float
    rho_star: float
    modes: tuple[Mode, ...]

    @property
    def ratio(self) -> float:
        """Stiffness ratio of the spectrum."""
        return self.spectrum.stiffness_ratio

    @property
    def distance(self) -> float:
        """Stiffness ratio relative to the limit of 2."""
        return self.ratio / LIMIT

    @property
    def needed(self) -> float:
        """Factor on all penalties above which the exact preconditioner reaches the limit."""
        return max((self.highest - 4 * self.lowest) / 3, 0.0)

    def exact_ratio(self, factor: float = 1.0) -> float:
        """Return the ratio of the exact preconditioner with these penalties.

        The rate of the duals is optimal. `factor` multiplies all penalties. The result is infinite
        if H + A'WA is not positive definite.
        """
        if factor + self.lowest <= 0:
            return float("inf")
        return max(LIMIT, float(np.sqrt((factor + self.highest) / (factor + self.lowest))))


@checked
def slowness_of(network: Network, x: State) -> Slowness:
    """Diagnose the settling speed of a network by linearisation at a settled point.

    The network must have PI duals, each with a penalty; `x` (n,) is the settled point. Raises
    `NetworkError` if the network has no PI duals, a constraint has no penalty, or the point is not
    isolated.
    """
    penalties = _penalties(network)
    saddle = saddle_of(network, x)
    weights = penalties[network.places[saddle.dual, 0]]
    try:
        values, vectors = slowest_modes(network, x, MODES)
        rows = multiplier_sensitivities(network, saddle, penalties)
        lowest, highest = saddle.sensitivity_range(weights)
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise NetworkError(
            f"{network.title}: the settled point is not isolated (its KKT matrix is singular), "
            "so its modes have no rates; omit states that neither cost nor constraints "
            "determine"
        ) from error
    return Slowness(
        spectrum=spectrum(network, x),
        rows=rows,
        lowest=lowest,
        highest=highest,
        rho_star=penalty_threshold(network, x),
        modes=tuple(_Modes(network, saddle, weights).mode(s, v) for s, v in zip(values, vectors.T)),
    )


def _penalties(network: Network) -> np.ndarray:
    """Return the path weight (P,) of every PI dual and diode neuron, otherwise zero."""
    if not network.cell.duals:
        raise NetworkError(
            f"{network.title}: has no PI dual neurons and therefore no constraints; only its "
            "spectrum is available"
        )
    weights = {connection.name: connection.weight for connection in network.cell.connections}
    penalties = np.zeros(len(network.cell.neurons))
    for dual in (*network.cell.duals, *network.cell.inequality_duals):
        given = np.asarray(weights.get(dual.path, 0.0), float)
        penalty = float(given.flat[0])
        if not (penalty > 0 and (given == penalty).all()):
            raise NetworkError(
                f"{network.title}: the constraint of {dual.neuron} has no penalty, or a penalty "
                "that differs between stages; set one penalty (manual_gains(rho=...)), or "
                "design the network"
            )
        penalties[network.neuron_index[dual.neuron]] = penalty
    return penalties


@dataclass(frozen=True, eq=False)
class _Modes:
    """Conversion of eigenvectors to modes; weights (d,) of the constraints."""

    network: Network
    saddle: Saddle
    weights: np.ndarray

    @cached_property
    def _unmove(self) -> Callable[[np.ndarray], np.ndarray]:
        """Operator v -> M^{-1} v."""
        return self.network.preconditioner.inverse(self.network.layout)

    def mode(self, s: complex, v: np.ndarray) -> Mode:
        saddle = self.saddle
        z, d = v[saddle.primal], v[saddle.dual]
        energies = np.real(np.conj(v) * (self._unmove(np.real(v)) + 1j * self._unmove(np.imag(v))))
        energy = energies.sum()
        pushed, push = saddle.A @ z, d / self.weights
        answer = saddle.answer(np.column_stack([np.real(push), np.imag(push)])) @ [1, 1j]
        return Mode(
            eigenvalue=complex(s),
            names=tuple(neuron.name for neuron in self.network.cell.neurons),
            shape=self._shape(v, energies),
            dual_share=float(energies[saddle.dual].sum() / energy),
            curvature=_quadratic(z, saddle.H @ z) / energy,
            penalty=_quadratic(pushed, self.weights * pushed) / energy,
            sensitivity=_quadratic(push, answer) / _quadratic(push, d),
        )

    def _shape(self, v: np.ndarray, energies: np.ndarray) -> np.ndarray:
        network = self.network
        shape = np.where(network.live, 0.0, np.nan)
        for row in range(len(shape)):
            own = network.places[:, 0] == row
            if own.any():
                turned = _turned(v[own]) * np.sqrt(max(energies[own].sum(), 0.0))
                shape[row, network.places[own, 1]] = turned
        return shape / np.sqrt(np.nansum(shape**2))


def _quadratic(left: np.ndarray, right: np.ndarray) -> float:
    return float(np.real(np.vdot(left, right)))


def _turned(values: np.ndarray) -> np.ndarray:
    """Return complex values (b,) as a real unit vector, at the phase of largest norm."""
    real = np.real(values * np.exp(-0.5j * np.angle((values**2).sum())))
    size = np.linalg.norm(real) * (1.0 if real[np.abs(real).argmax()] >= 0 else -1.0)
    return real / (size or 1.0)
