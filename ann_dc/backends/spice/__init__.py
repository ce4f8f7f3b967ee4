"""Networks as SPICE circuits: decks (`deck`, `levels`), ngspice (`runner`), its answers (`raw`)."""
