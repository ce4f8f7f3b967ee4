"""ngspice: a deck goes in, a table comes out, or a reason. This room knows no network."""
