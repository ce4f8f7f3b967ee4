"""Networks as circuits in ngspice: a netlist is written, simulated, and read back by neuron."""
