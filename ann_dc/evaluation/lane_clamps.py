"""Clamps called by address from compiled and generated code.

A table contains array sizes and addresses. Clamps are therefore compiled only for networks with
saturation limits at neurons that the preconditioner couples. States, net inputs and derivatives are
at places that the caller chooses. They belong to one state, or to one sample in every lane; each
sample has a separate set of held neurons.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.np.numpy_support import carray

from ann_dc.evaluation import rules
from ann_dc.evaluation.calls import (
    WIDTH,
    cube,
    entries,
    floats,
    integer_matrix,
    integer_vector,
    integers,
    matrix,
    vector,
)
from ann_dc.evaluation.formulas import called_by_address, inner
from ann_dc.evaluation.pivots import clamp, has_limit
from ann_dc.evaluation.solves import UNKNOWN, Couplings, Hold
from ann_dc.evaluation.tape import Tape

_pushes_out = inner(rules.pushes_out)

ARRAYS = (
    "drives",
    "rates_of_lanes",
    "roots",
    "at",
    "state_at",
    "values",
    "arriving",
    "derivatives",
    "nodes",
    "held",
    "factor",
    *Couplings._fields,
)
"""Arrays of a clamp in table order; each has an address and three sizes."""


class LaneClamps:
    """Arrays of the clamps of all lanes, and their table for generated code.

    ``at`` and ``state_at`` (P, N) are the offsets of the neurons in the first lane, among net
    inputs and derivatives, and among states; -1 if there is none. ``lanes`` is 1, or the samples of
    a group. ``given`` contains the uncut net inputs ``drives``, and ``rates_of_lanes`` and
    ``roots`` if every sample has separate ones.
    """

    def __init__(
        self,
        tape: Tape,
        at: np.ndarray,
        state_at: np.ndarray,
        lanes: int,
        given: dict[str, np.ndarray],
    ) -> None:
        hold = Hold.of(tape)
        own = {name: getattr(tape, name).copy() for name in Couplings._fields}
        own["rates"] = np.tile(tape.rates, (lanes if "rates_of_lanes" in given else 1, 1, 1))
        self.arrays = own | {
            "at": at,
            "state_at": state_at,
            "values": hold.values,
            "arriving": hold.drives,
            "derivatives": hold.derivatives,
            "nodes": hold.nodes,
            "held": np.tile(hold.held, (lanes, 1, 1)),
            "factor": np.tile(hold.factor, (lanes, 1, 1)),
            "drives": given["drives"],
            "rates_of_lanes": given.get("rates_of_lanes", np.zeros(0)),
            "roots": given.get("roots", np.zeros(0)),
        }
        self.table = np.array([lanes, *entries(self.arrays[name] for name in ARRAYS)], np.int64)

    def renumber(self, tape: Tape) -> None:
        """Copy the numbers of another tape with the same wiring."""
        for name in Couplings._fields:
            self.arrays[name][...] = getattr(tape, name)
        self.arrays["held"][...] = UNKNOWN


# ---- as compiled code sees the table -------------------------------------------------------------


_FIRST = 1
(
    _DRIVES, _RATES_OF_LANES, _ROOTS, _AT, _STATE_AT, _VALUES, _ARRIVING, _DERIVATIVES, _NODES,
    _HELD, _FACTOR, _RATES, _LIMITS, _REACHED, _CHAINS, _GRIDS, _GRID_STARTS, _HATS, _SHARES,
    _COUPLED, _STIFF,
) = range(_FIRST, _FIRST + WIDTH * len(ARRAYS), WIDTH)  # fmt: skip


@inner
def _couplings(table, lane):
    rates = cube(table, _RATES)
    return Couplings(
        rates[min(lane, rates.shape[0] - 1)], matrix(table, _LIMITS),
        integer_vector(table, _REACHED),
        integer_matrix(table, _CHAINS), cube(table, _GRIDS),
        integer_vector(table, _GRID_STARTS), integer_vector(table, _HATS),
        vector(table, _SHARES), integer_matrix(table, _COUPLED), matrix(table, _STIFF),
    )  # fmt: skip


@inner
def _hold(table, lane):
    return Hold(
        matrix(table, _VALUES), matrix(table, _ARRIVING), matrix(table, _DERIVATIVES),
        matrix(table, _NODES), cube(table, _HELD)[lane], cube(table, _FACTOR)[lane],
    )  # fmt: skip


@inner
def _is_at_rail(couplings, state_at, x, lane):
    for p in couplings.reached:
        if has_limit(couplings.limits, p):
            low, high = couplings.limits[p, 0], couplings.limits[p, 1]
            for k in range(state_at.shape[1]):
                at = state_at[p, k]
                if at >= 0 and (x[at + lane] <= low or x[at + lane] >= high):
                    return True
    return False


@inner
def _gather(couplings, hold, places, tables, lane):
    """Copy states, net inputs and rates of a lane; a new sample has no held set yet."""
    (at, state_at), (x, drives, rates, roots), is_other = places, tables, False
    for p in couplings.reached:
        for k in range(at.shape[1]):
            if at[p, k] >= 0:
                place = at[p, k] + lane
                root = roots[place] if roots.shape[0] > 0 else 1.0
                hold.values[p, k + 1] = x[state_at[p, k] + lane]
                hold.drives[p, k] = root * drives[place]
                if rates.shape[0] > 0 and couplings.rates[p, k] != rates[place]:
                    couplings.rates[p, k], is_other = rates[place], True
    for p in range(hold.held.shape[0] if is_other else 0):
        for k in range(hold.held.shape[1]):
            hold.held[p, k] = UNKNOWN


@inner
def _scatter(couplings, hold, places, tables, out, lane):
    """Write the derivatives of a lane and cut net inputs at limits."""
    (at, _), (_, drives, _, roots) = places, tables
    for p in couplings.reached:
        low, high = couplings.limits[p, 0], couplings.limits[p, 1]
        for k in range(at.shape[1]):
            if at[p, k] >= 0:
                place = at[p, k] + lane
                root = roots[place] if roots.shape[0] > 0 else 1.0
                out[place] = root * hold.derivatives[p, k]
                if _pushes_out(hold.values[p, k + 1], drives[place], low, high):
                    drives[place] = 0.0


def _clamp_lanes(table, x, out):
    head = carray(integers(table), (_FIRST + WIDTH * len(ARRAYS),))
    places, drives = (
        (integer_matrix(head, _AT), integer_matrix(head, _STATE_AT)),
        vector(head, _DRIVES),
    )
    states, derivatives = carray(floats(x), drives.shape), carray(floats(out), drives.shape)
    tables = states, drives, vector(head, _RATES_OF_LANES), vector(head, _ROOTS)
    for lane in range(head[0]):
        couplings = _couplings(head, lane)
        if _is_at_rail(couplings, places[1], states, lane):
            hold = _hold(head, lane)
            _gather(couplings, hold, places, tables, lane)
            clamp(couplings, hold)
            _scatter(couplings, hold, places, tables, derivatives, lane)
    return 0


@cache
def clamp_code() -> Any:
    """Return ``i64 clamp(table, x, out)`` with its ``address``, compiled if needed.

    The code projects the derivatives ``out`` of all states ``x`` at saturation limits on these
    limits. It cuts the uncut net inputs of the neurons that the preconditioner couples.
    """
    return called_by_address(_clamp_lanes, types.int64(types.int64, types.int64, types.int64))
