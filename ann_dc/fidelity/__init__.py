"""How far a circuit is from the ideal: predicted, drawn, in noise, budgeted, studied, climbed."""
