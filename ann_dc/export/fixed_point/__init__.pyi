from .widths import fixed_point as fixed_point
