"""The part of a tape that says how drives become moves.

A pyramid is its grids and hats, a stiffness its triangular factor; each kind of metric leaves the
arrays of the others empty.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.errors import NetworkError
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
    metric.check(row)
    arrays = _EMPTY
    if isinstance(metric, Pyramid):
        arrays = arrays | _pyramid(metric, row)
    if isinstance(metric, Stiffness):
        arrays = arrays | _stiffness(metric, row)
    return arrays


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
    used = row.component[row.primal].T
    used = used[used >= 0]
    factors = scipy.sparse.linalg.splu(
        sparse.csc_array(stiffness.matrix(row)[used][:, used]),
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    pivots, order = factors.U.diagonal(), used[np.argsort(factors.perm_c)]
    if (factors.perm_r != factors.perm_c).any() or not (pivots > 0).all():
        raise NetworkError(f"{stiffness.kind.value}: the stiffness is not positive definite")
    # S = L D L', with ones on the diagonal of L
    left = sparse.diags_array(1 / np.sqrt(row.state_rates[order]))
    lower = sparse.csr_array(left @ factors.L @ sparse.diags_array(np.sqrt(pivots)))
    lower.sort_indices()
    ends = lower.indptr[1:] - 1
    lower.data[ends] = 1 / lower.data[ends]
    neuron, stage = _places(row)[order].T
    coupled = np.column_stack([neuron, stage, lower.indptr[:-1]])
    return {
        "coupled": np.vstack([coupled, [-1, -1, lower.nnz]]).astype(np.int64),
        "factor": lower.data,
        "factor_columns": lower.indices.astype(np.int64),
    }


def _places(row: Row) -> np.ndarray:
    """(n, 2): neuron and stage of the components of the state vector."""
    stage, neuron = np.nonzero(row.rates.T)
    return np.column_stack([neuron, stage])
