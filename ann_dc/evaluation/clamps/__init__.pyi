from .projection import projected as projected
