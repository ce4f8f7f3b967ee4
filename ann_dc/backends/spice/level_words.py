"""Model levels by the names on the command line: fixed, or made for a network."""

from __future__ import annotations

from collections.abc import Callable

from ann_dc.analysis.spectra import stability_limit
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.foundry import SKY130
from ann_dc.hardware.parts.levels import (
    BEHAVIOURAL,
    TRANSISTOR,
    Level,
    macro,
    ota_c,
    switched_capacitor,
)
from ann_dc.network.network import Network

STEP = 0.3
"""Step of a switched-capacitor circuit relative to the stability limit at the start."""


def level_words() -> dict[str, Level | Callable[..., Level]]:
    """Return every level by its name, or a function that makes it.

    The function takes a network and figures of its op amps by name. It is present for levels whose
    op amps can be chosen.
    """
    known: dict[str, Level | Callable[..., Level]] = {
        "behavioural": BEHAVIOURAL,
        "macro": lambda _, **op_amps: macro(**op_amps),
        "differential": lambda _, **op_amps: macro(differential=True, **op_amps),
        "ota-c": lambda _, **op_amps: ota_c(**op_amps),
        "switched-capacitor": _switched,
        "transistor": TRANSISTOR,
        "sky130": SKY130,
    }
    return known | {name: presets.get(name) for name in presets.names()}


def _switched(network: Network, *, a0: float = 1e6, **op_amps: float) -> Level:
    step = STEP * stability_limit(network, network.start_state)
    return switched_capacitor(step=step, a0=a0, **op_amps)
