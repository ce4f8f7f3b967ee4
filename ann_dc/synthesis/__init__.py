"""How stage equations become a cell, and cells a network."""
