"""Studies: what many runs of a network say together."""
