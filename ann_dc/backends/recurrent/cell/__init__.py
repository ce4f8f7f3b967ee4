"""One step of a network as torch computes it."""
