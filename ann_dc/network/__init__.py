"""What is wired: one cell, repeated N times, and everything that is read off it."""
