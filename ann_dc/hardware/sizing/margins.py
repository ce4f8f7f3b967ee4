r"""Margins at which a circuit does not ring: the eigenvalues of its emulation decide.

Of a grid with diode neurons they do not suffice. While a row presses nothing, the op amp of its
diode neuron moves all the same, which lets a share of the row's rate through, the smaller the
faster op amps are. The nodes of a grid divide by lambda, the smallest eigenvalue of their stiffness
over its diagonal, so that Omega lambda has to be `FOLLOWING` or more. In ngspice, macro models,
long waves of the lander (N = 50, lambda = 2.8e-4) grow at 0.022 and settle as predicted at 0.09.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.analysis.spectra import spectrum
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.metric_wiring import wiring_of
from ann_dc.hardware.sizing.resistors import two_digits
from ann_dc.progress import Progress, silent
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State

HIGHEST = 1e4
"""Margins above that are none."""

SPARE = 1.5
"""Margin over the smallest one: what a pole model does not know, and time to settle."""

FOLLOWING = 0.08
"""Omega lambda of a grid with diode neurons, at least; Omega in radians per network time."""


@checked
def is_stable(circuit: Circuit, level: Level, x: State) -> bool:
    """Whether a circuit comes to rest where the ideal network stands.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    return pole_spectrum(emulate(circuit, level), x).abscissa < 0


@checked
def least_margin(circuit: Circuit, level: Level, x: State, *, progress: Progress = silent) -> float:
    """The smallest margin from 1 on with which a circuit is stable, to 1 %.

    Parameters
    ----------
    circuit : Circuit
        Of any margin; its resistors are kept.
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network where it settles.
    progress : Progress
        Told every margin that is tried.

    Returns
    -------
    float
        Infinite if not even 10000 is enough.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    radius = spectrum(circuit.schematic.network, x).radius
    wanted = radius / (2 * np.pi * level.datasheet.usable_bandwidth)  # time at a margin of one

    def stable(margin: float) -> bool:
        progress(f"smallest margin: is {margin:.3g} enough?")
        return is_stable(circuit.slower(margin * wanted / circuit.scaling.time), level, x)

    low, high = 1.0, 1.0
    while not stable(high):
        low, high = high, 2 * high
        if high > HIGHEST:
            return float("inf")
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if stable(middle) else (middle, high)
    return high


@checked
def following_margin(circuit: Circuit, level: Level) -> float:
    """Return the smallest margin at which idle diode neurons do not move a grid.

    Parameters
    ----------
    circuit : Circuit
        Of any margin.
    level : Level
        Speed of its parts.

    Returns
    -------
    float
        Zero without a grid of several nodes, and without diode neurons.
    """
    network, scaling = circuit.schematic.network, circuit.scaling
    wiring = wiring_of(network) if network.cell.diodes else None
    if wiring is None or not wiring.passive or len(wiring.moved) == 1:
        return 0.0
    between = sparse.csr_array(wiring.weights)[wiring.moved][:, wiring.moved]
    paired = between.sign() * (between * between.T).power(0.5)
    stiffness = sparse.csc_array(sparse.eye_array(len(wiring.moved)) - paired)
    softest = scipy.sparse.linalg.eigsh(
        stiffness, k=1, sigma=0.0, v0=np.ones(len(wiring.moved)), return_eigenvectors=False
    )
    per_margin = 2 * np.pi * level.datasheet.usable_bandwidth * scaling.time / scaling.margin
    return FOLLOWING / (per_margin * float(softest[0]))


@checked
def check_following(circuit: Circuit, level: Level) -> None:
    """Refuse a circuit whose grid would repel, although its eigenvalues do not say so.

    Parameters
    ----------
    circuit : Circuit
    level : Level

    Raises
    ------
    NetworkError
        With the margin that is enough, if the circuit has less than half of it.
    """
    wanted, margin = following_margin(circuit, level), circuit.scaling.margin
    if 2 * margin < wanted:
        raise NetworkError(
            f"margin: {margin:.3g} is too small: op amps of idle diode neurons would move the "
            f"soft long waves of the {circuit.schematic.network.metric.kind.value}; take a margin "
            f"of {-two_digits(-wanted):.3g} (ann-dc circuit --margin), or design the network with "
            "kinds=[Kind.TREE] (--metric tree)"
        )
