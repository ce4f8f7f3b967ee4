"""Effects of multipliers, capacitors and reset switches on a board."""

PASSIVES: dict[str, dict[str, float]] = {
    "multipliers bent by 0.1 %": {"multiplier_nonlinearity": 1e-3},
    "multipliers bent by 0.4 %": {"multiplier_nonlinearity": 4e-3},
    "0.3 % of feedthrough": {"multiplier_feedthrough": 3e-3},
    "5 pF at every input of a multiplier": {"multiplier_capacitance": 5e-12},
    "insulators of 0.1 s": {"capacitor_leakage": 0.1},
    "open switches of 1 Gohm": {"switch_leakage": 1e9},
    "open switches of 5 pF": {"switch_capacitance": 5e-12},
    "open switches of 1 Gohm and 5 pF": {"switch_leakage": 1e9, "switch_capacitance": 5e-12},
    "switches that leave 0.5 pC": {"switch_charge": 0.5e-12},
    "switches that leave 5 pC": {"switch_charge": 5e-12},
}
"""Parasitics of these parts, by their description; rows of the effects table."""
