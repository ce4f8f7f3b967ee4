"""Networks and circuits for other tools."""
