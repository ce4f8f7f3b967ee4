"""Saturation limits of neurons: levels that support them, neurons that have parts."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.levels import Level
from ann_dc.network.network import Network
from ann_dc.network.selection import clamped_rows
from ann_dc.validation import checked

HIGHEST = 1.0
"""Largest full scale in volts for which limits are built.

The op amp of a clamp rests one diode drop from the clamped node, where the diode must not conduct
yet.
"""


TRANSISTORS = ("transistor", "sky130")
"""Folders of models without clamps."""


@checked
def check_rails(network: Network, level: Level) -> None:
    """Raise `NetworkError` if a neuron has limits that a level cannot build.

    Limits need a level of single-ended op amps, ideal or as macro models, with a full scale of at
    most `HIGHEST`.
    """
    names = ", ".join(_railed(network))
    if not names:
        return
    if level.technology.differential or level.models in TRANSISTORS:
        raise NetworkError(
            f"circuit: rails of {names} are not built at level {level.name}; take a level of "
            "single-ended op amps, ideal or macro models: 'behavioural' or 'macro'"
        )
    if level.full_scale > HIGHEST:
        fit = [name for name in presets.names() if presets.get(name).full_scale <= HIGHEST]
        raise NetworkError(
            f"full_scale: rails of {names} are built up to {HIGHEST:g} V, level {level.name} has "
            f"{level.full_scale:g} V; take a full scale of {HIGHEST:g} V (ann-dc circuit "
            f"--full-scale {HIGHEST:g}), or parts that have it: macro, {', '.join(fit)}"
        )


@checked
def with_rails(network: Network, level: Level) -> Level:
    """Return the level with a full scale of at most `HIGHEST` if neurons have limits."""
    fits = level.full_scale <= HIGHEST or not _railed(network)
    return level if fits else replace(level, full_scale=HIGHEST)


def check_parts(network: Network, fused: Container[str], *, differential: bool) -> None:
    """Raise `NetworkError` if a neuron has limits that its part cannot realise.

    Only a separate integrator has limits. A neuron merged with other nodes (``fused``), any neuron
    of a differential circuit, and a neuron that the preconditioner couples to others have none. The
    message names the neurons.
    """
    coupled = [network.cell.neurons[row].name for row in clamped_rows(network)]
    names = [n for n in _railed(network) if differential or n in coupled or n in fused]
    if names:
        why = "only an integrator of its own has some, no dual"
        if differential:
            why = "differential parts have none"
        elif coupled:
            kind = network.preconditioner.kind.value
            why = (
                f"a clamp holds one integrator, and the {kind} couples "
                f"{', '.join(coupled)} to others; take the circuit of SpiceBackend.prepare, whose "
                "network has rows in the place of such rails"
            )
        raise NetworkError(f"circuit: rails of {', '.join(names)} cannot be built: {why}")


def _railed(network: Network) -> list[str]:
    """Return the neurons that have a saturation limit."""
    return [
        neuron.name
        for neuron in network.cell.neurons
        if np.isfinite([neuron.limiter.low, neuron.limiter.high]).any()
    ]
