"""How it is split: stage Lagrangian (8)-(10) and stationarity (11)-(15), corrected and printed."""
