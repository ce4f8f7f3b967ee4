r"""Settled point as a function of the inputs: implicit differentiation.

At a settled point the drives vanish, d(x, p) = 0, so dx/dp = -J^{-1} dd/dp with J = dd/dx. The
preconditioner cancels: gains change the path to the optimum, not the optimum. One Newton step that
remains attached to the graph gives value and derivative,

.. math:: x = x^* - J^{-1}\, d(x^*, p) ,

with x* and J detached from the graph: its value is x*, and its derivative is the one above.

References
----------
Bai, Kolter and Koltun, Deep equilibrium models, NeurIPS 2019; Griewank and Walther, Evaluating
Derivatives (2008), chapter 15.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse.linalg
import torch
from scipy import sparse
from torch.autograd.function import once_differentiable

from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network


def attached(flow: Flow, x: torch.Tensor) -> torch.Tensor:
    """Return settled states (B, n), connected to the inputs and weights of ``flow``.

    ``x`` contains settled state vectors (B, n) in network units. The result has equal values up to
    one Newton step. Only first derivatives are supported.

    References
    ----------
    Bai, Kolter and Koltun, Deep equilibrium models, NeurIPS 2019.
    """
    x = x.detach()
    drives = flow.layout.pack(flow.read(flow.layout.fill(x, flow.inputs)).drives)
    return x - solve_jacobian(flow, x, drives)


def solve_jacobian(flow: Flow, x: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """Return J^{-1} right (B, n) at states (B, n), differentiable in ``right`` (B, n).

    The states are state vectors at which J = d drive / dx is taken. The factors are sparse and
    computed on the CPU, one sample after the other, so that memory is linear in the number of
    neurons. Samples without a finite or regular J are returned as nan.
    """
    with torch.no_grad():
        state = flow.layout.fill(x, flow.inputs)
        entries, resting = flow.jacobian_entries(state), flow.resting(state)
    factors = _factors(
        flow.layout.network, entries.T.cpu().double().numpy(), resting.cpu().double().numpy()
    )
    return _Solve.apply(right, factors)  # pyright: ignore[reportReturnType]


def _factors(network: Network, entries: np.ndarray, resting: np.ndarray) -> list[Any]:
    factors = []
    for data, rails in zip(entries, resting):
        try:
            # a neuron at its rail stays there: its row of J is zero, and here one
            matrix = (evaluator(network).sparse(data) + sparse.diags_array(rails)).tocsc()
            factors.append(scipy.sparse.linalg.splu(matrix) if np.isfinite(data).all() else None)
        except RuntimeError:  # exactly singular: the point is not isolated
            factors.append(None)
    return factors


class _Solve(torch.autograd.Function):
    """Solution x = J^{-1} b with fixed J, sample by sample; its adjoint is J^{-T}."""

    @staticmethod
    def forward(ctx, right, factors):
        ctx.factors = factors
        return _solved(factors, right, "N")

    @staticmethod
    @once_differentiable
    def backward(ctx, *gradients):  # pyright: ignore[reportIncompatibleMethodOverride]
        return _solved(ctx.factors, gradients[0], "T"), None


def _solved(factors: list[Any], right: torch.Tensor, kind: str) -> torch.Tensor:
    rows = right.detach().cpu().double().numpy()
    solved = np.full(rows.shape, np.nan)
    for sample, (factor, row) in enumerate(zip(factors, rows)):
        if not row.any():  # nothing asked of a sample, which may have no J
            solved[sample] = 0.0
        elif factor is not None and np.isfinite(row).all():
            solved[sample] = factor.solve(row, kind)
    return torch.as_tensor(solved).to(right)
