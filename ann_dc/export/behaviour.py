"""Behaviour of a network in a file: its settling, or its unstable equilibrium.

A network that is not an optimiser need not settle. An oscillator or a chaotic network has unstable
equilibria, from which deviations grow as exp(sigma s) cos(omega s), where sigma +- i omega is the
eigenvalue of the largest real part.
"""

from __future__ import annotations

import math
from pathlib import Path

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.status import Outcome
from ann_dc.errors import NetworkError
from ann_dc.network.network import Network

UNDAMPED = 1e-9
"""Decay rate, relative to the fastest mode, below which a mode does not decay."""

TIME_CONSTANTS = 100.0
"""Suggested duration in time constants 1 / abs(sigma + i omega) of the growing mode."""


def behaviour(network: Network, file: Path) -> tuple[dict[str, str], str]:
    """Run a network until it settles, and return its facts and the first error, if any.

    The equilibrium nearest to the start is analysed if the network does not settle. Inputs over
    time have their values at time zero.
    """
    network = network.at_time(0.0)
    status = OdeBackend(verify=False).run(network).status
    if status.settled:
        return {"settles": str(status)}, ""
    duration, sentence = _at_equilibrium(network)
    optimiser = bool(network.cell.duals) or bool(network.of_population("u").any())
    if (
        optimiser
        or duration is None
        or status.outcome
        not in (
            Outcome.STALLED,
            Outcome.NOT_SETTLED,
        )
    ):
        return {"settles": str(status), "equilibrium": sentence}, f"it does not settle: {status}"
    return {
        "settles": f"no (ran for {status.time:.4g} unit time constants); a run needs a duration",
        "equilibrium": sentence,
        "next": f"ann-dc run {file} --duration {float(f'{duration:.1g}'):g} (or ann-dc circuit)",
    }, ""


def _at_equilibrium(network: Network) -> tuple[float | None, str]:
    """Return a duration that shows the growing mode, and a sentence on the equilibrium.

    The duration is None if the equilibrium is stable.
    """
    try:
        x = equilibrium(network, network.start_state)
        modes = spectrum(network, x)
    except NetworkError:
        rate = spectrum(network, network.start_state).radius
        return TIME_CONSTANTS / (rate or 1.0), "none found from the start (Newton's method)"
    largest = max(modes.eigenvalues, key=lambda value: value.real)
    growth, omega = float(largest.real), abs(float(largest.imag))
    if growth < -UNDAMPED * modes.radius:
        return None, f"stable: the slowest mode decays at {-growth:.3g} per unit time constant"
    swing = ""
    if omega:
        swing = (
            f" and oscillate at {omega:.3g} rad per unit time constant (period "
            f"{2 * math.pi / omega:.3g})"
        )
    pace = f"grow at {growth:.3g} per unit time constant"
    if abs(growth) <= UNDAMPED * modes.radius:
        return TIME_CONSTANTS / abs(largest), f"undamped: deviations do not decay{swing}"
    return TIME_CONSTANTS / abs(largest), f"unstable: deviations {pace}{swing}"
