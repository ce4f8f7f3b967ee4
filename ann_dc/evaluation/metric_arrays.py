"""The part of a tape that says how drives become moves.

A pyramid is its grids and hats, a stiffness its triangular factor; each kind of metric leaves the
arrays of the others empty.
"""

from __future__ import annotations

import numpy as np

from ann_dc.network.metrics.contract import Metric, Row
from ann_dc.network.metrics.pyramid import Pyramid, hat_positions
from ann_dc.network.metrics.stiffness import Stiffness


def metric_arrays(metric: Metric, row: Row) -> dict[str, np.ndarray]:
    """Fields of `Tape`, from ``chains`` on.

    Parameters
    ----------
    metric : Metric
    row : Row
        Of the network, with the rates that the tape has.

    Returns
    -------
    dict of str to array

    Raises
    ------
    NetworkError
        If the metric does not fit the row.
    """
    if isinstance(metric, Stiffness):
        return _EMPTY | _stiffness(metric, row)
    metric.check(row)
    return _EMPTY | _pyramid(metric, row) if isinstance(metric, Pyramid) else _EMPTY


_EMPTY = {
    "chains": np.zeros((0, 2), np.int64),
    "grids": np.zeros((0, 0, 0)),
    "grid_starts": np.zeros(1, np.int64),
    "hats": np.zeros(0, np.int64),
    "shares": np.zeros(0),
    "coupled": np.zeros((1, 3), np.int64),
    "factor": np.zeros(0),
    "factor_columns": np.zeros(0, np.int64),
}


def _pyramid(pyramid: Pyramid, row: Row) -> dict[str, np.ndarray]:
    sizes = [len(gain) for gain in pyramid.gains]
    hats, shares = hat_positions(2 * row.stages, sizes[0] - 1)
    return {
        "chains": row.chains,
        "grids": np.concatenate(pyramid.gains),
        "grid_starts": np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        "hats": hats,
        "shares": shares,
    }


def _stiffness(stiffness: Stiffness, row: Row) -> dict[str, np.ndarray]:
    """K of K K' = T^{-1/2} S T^{-1/2}, in the order of the row: no further than its neighbours."""
    band, component = stiffness.cholesky(row), row.component[row.primal].T.ravel()
    below, column = np.nonzero(band)
    used = component[column] >= 0
    column, below = column[used], below[used]
    by_row = np.lexsort((column, column + below))
    column, below = column[by_row], below[by_row]
    live = np.flatnonzero(component >= 0)
    order, starts = component[live], np.searchsorted(column + below, live)
    factor = band[below, column] / np.sqrt(row.state_rates[component[column + below]])
    ends = np.append(starts[1:], len(column)) - 1
    factor[ends] = 1 / factor[ends]
    neuron, stage = _places(row)[order].T
    coupled = np.column_stack([neuron, stage, starts])
    return {
        "coupled": np.vstack([coupled, [-1, -1, len(column)]]).astype(np.int64),
        "factor": factor,
        "factor_columns": np.searchsorted(live, column).astype(np.int64),
    }


def _places(row: Row) -> np.ndarray:
    """(n, 2): neuron and stage of the components of the state vector."""
    stage, neuron = np.nonzero(row.rates.T)
    return np.column_stack([neuron, stage])
