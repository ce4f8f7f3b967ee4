"""One network as parts, wires, volts and ohms, every number of which has a name."""
