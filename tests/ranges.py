"""Ranges over which function generators are built in tests, one a function block."""

RANGES = {
    "sin": (-1.3, 1.3),
    "cos": (-0.38, 1.49),
    "tan": (-1.03, 1.0),
    "exp": (-2.0, 1.0),
    "log": (0.5, 2.0),
    "sqrt": (0.2, 2.0),
    "reciprocal": (0.5, 1.5),
    "tanh": (-1.5, 2.0),
    "sinh": (-2.0, 2.0),
    "cosh": (-1.0, 2.0),
    "atan": (-1.5, 1.5),
    "asin": (-0.8, 0.8),
    "acos": (-0.8, 0.8),
    "rectify": (-1.0, 1.0),
    "abs": (-1.0, 1.0),
    "sigmoid": (-2.0, 2.4),
}
SMOOTH = [name for name in RANGES if name not in ("rectify", "abs")]
