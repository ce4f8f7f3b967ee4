"""Networks that circuits of a model level can realise: preconditioner, limits, shared neurons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.e_series import EXACT, Series
from ann_dc.hardware.parts.levels import Level
from ann_dc.network.network import Network
from ann_dc.network.preconditioners import base as contract
from ann_dc.validation import checked

HIGHEST = 1.0
"""Largest full scale in volts for which limits are built.

The op amp of a clamp rests one diode drop from the clamped node, where the diode must not conduct
yet.
"""


@checked
def check_buildable(network: Network, level: Level, series: Series = EXACT) -> None:
    """Raise `NetworkError` if a level cannot build a network with resistors of a series.

    Limits of neurons need a level of single-ended op amps, ideal or as macro models, with a full
    scale of at most `HIGHEST`. Only single-ended op amps have lines for shared neurons, and only
    levels of op amps have resistors.
    """
    check_preconditioner(network.preconditioner.kind, level)
    if series.mantissas and not level.technology.has_resistors:
        raise NetworkError(
            f"series {series.name}: {level.name} circuits have no resistors; use exact"
        )
    _check_limits(network, level)
    names = ", ".join(neuron.name for neuron in network.cell.neurons if neuron.shared)
    if names and level.technology.differential:
        raise NetworkError(
            f"circuit: {names}: a neuron shared by all cells is not supported at level "
            f"{level.name}; use behavioural, macro or transistor op amps"
        )


@checked
def check_preconditioner(kind: contract.PreconditionerKind, level: Level) -> None:
    """Raise `NetworkError` if a level cannot build a preconditioner kind.

    The message lists the kinds that it can build.
    """
    if kind not in level.preconditioners:
        known = ", ".join(known.value for known in level.preconditioners)
        raise NetworkError(
            f"preconditioner: {level.name} circuits cannot build a {kind.value}; design the "
            f"network with one of: {known}; or use a level of op amps with their poles"
        )


def _check_limits(network: Network, level: Level) -> None:
    names = ", ".join(limited_neurons(network))
    if not names:
        return
    if level.technology.differential or level.transistors:
        raise NetworkError(
            f"circuit: saturation limits of {names} are not supported at level {level.name}; "
            "use a level of single-ended op amps, ideal or macro models: 'behavioural' or "
            "'macro'"
        )
    if level.full_scale > HIGHEST:
        fit = [name for name in presets.names() if presets.get(name).full_scale <= HIGHEST]
        raise NetworkError(
            f"full_scale: saturation limits of {names} are supported up to {HIGHEST:g} V, level "
            f"{level.name} has {level.full_scale:g} V; use a full scale of {HIGHEST:g} V "
            f"(ann-dc circuit --full-scale {HIGHEST:g}), or parts with that full scale: macro, "
            f"{', '.join(fit)}"
        )


@checked
def clamped_full_scale(network: Network, level: Level) -> Level:
    """Return the level with a full scale of at most `HIGHEST` if neurons have limits."""
    fits = level.full_scale <= HIGHEST or not limited_neurons(network)
    return level if fits else replace(level, full_scale=HIGHEST)


def limited_neurons(network: Network) -> list[str]:
    """Return the neurons that have a saturation limit."""
    return [
        neuron.name
        for neuron in network.cell.neurons
        if np.isfinite([neuron.limiter.low, neuron.limiter.high]).any()
    ]
