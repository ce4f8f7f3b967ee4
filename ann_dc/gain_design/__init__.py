"""gain_design."""
