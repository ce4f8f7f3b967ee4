from .projection import clamped_rows as clamped_rows, projected as projected
