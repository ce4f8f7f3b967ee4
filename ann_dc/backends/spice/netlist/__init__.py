"""The SPICE text of a circuit: nodes, values and cards of a cell, and the deck."""
