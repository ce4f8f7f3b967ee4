"""Figures of solutions, designs, Pareto fronts and circuits.

Four figures show a solution: trajectory, controls, settling and spectrum. One shows the diagnosis
of a design, one a design over an operating range, and one a front. Two show circuits: voltages, and
the level comparison. `style` has the colours and labels for other figures.

Every function returns a separate `matplotlib.figure.Figure`, without pyplot or global state, so no
figure needs closing. Runs that did not settle are drawn as far as they are finite.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
