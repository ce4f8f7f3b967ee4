r"""Recurrent layer: many steps of a network, unrolled, until settled, or as an equilibrium.

At a settled point the drives vanish, d(x, p) = 0, so dx/dp = -J^{-1} dd/dp with J = dd/dx. The
preconditioner cancels: gains change the path to the optimum, not the optimum. One Newton step that
remains attached to the graph gives value and derivative,

.. math:: x = x^* - J^{-1}\, d(x^*, p) ,

with x* and J detached from the graph: its value is x*, and its derivative is the one above.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import scipy.sparse.linalg
import torch
from scipy import sparse
from torch import nn
from torch.autograd.function import once_differentiable

from ann_dc.backends.lane_batch import ends_of
from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.flow import Flow
from ann_dc.backends.layers.ledger import Ledger, Settled
from ann_dc.backends.layers.loop import Loop
from ann_dc.backends.settling import Settling
from ann_dc.backends.step_rules import (
    SIMULTANEOUS,
    AdaptiveStep,
    Anderson,
    Order,
    StepRule,
    check_order,
)
from ann_dc.errors import require_positive
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.progress import Paced, Progress, Stopped, silent
from ann_dc.validation import checked

LONGER = AdaptiveStep(share=0.9, first=0.3)
"""Default step rule with acceleration: combinations of steps stabilise longer steps."""


@checked
class RecurrentLayer(nn.Module):
    """Network as a recurrent layer.

    Parameters
    ----------
    network : Network
        Network whose cell is repeated.
    order : Order
        Update order: `SIMULTANEOUS`, `TWO_PHASE` or `STAGE_BY_STAGE`.
    step : StepRule
        Step rule: `AdaptiveStep` by default, with longer steps under acceleration, or
        ``FixedStep(step=h)``.
    acceleration : Anderson or None
        Acceleration; None takes every step as the network gives it.
    dtype, device, trainable
        Arguments of `CellLayer`.

    Raises
    ------
    NetworkError
        If torch does not have ``dtype`` or ``device``.

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> network = design(plants.double_integrator(N=5)).network
    >>> layer = RecurrentLayer(network)
    >>> targets = {"q_d.x": [0.5, 1.0, 2.0]}
    >>> layer.settle(inputs=targets).codes.tolist()
    [1, 1, 1]

    References
    ----------
    Paper equations (16), (17), corrected.
    """

    def __init__(
        self,
        network: Network,
        *,
        order: Order = SIMULTANEOUS,
        step: StepRule | None = None,
        acceleration: Anderson | None = None,
        dtype: torch.dtype = torch.float64,
        device: str | torch.device = "cpu",
        trainable: bool = False,
    ) -> None:
        super().__init__()
        check_order(order, network)
        self.cell = CellLayer(network, dtype=dtype, device=device, trainable=trainable)
        self.order, self.acceleration = order, acceleration
        self.step = step or (AdaptiveStep() if acceleration is None else LONGER)

    @checked
    def forward(
        self,
        x: torch.Tensor | None = None,
        inputs: Mapping[str, object] | None = None,
        *,
        steps: int,
    ) -> torch.Tensor:
        """Return state vectors (B, n) after a number of steps.

        The result is differentiable in all arguments and weights. Acceleration is not applied, and
        the step lengths count as constants.

        Parameters
        ----------
        x : (n,) or (B, n) tensor, optional
            Initial guess in network units; `CellLayer.starts` by default.
        inputs : mapping of input name to number, (B,) or (B, N) array or tensor, optional
            Inputs that replace those of ``network.inputs``.
        steps : int
            Number of steps; all are stored for the derivative.

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist, or sizes do not agree.
        """
        loop = self._loop(x, inputs, None)
        for _ in range(steps):
            loop.advance()
        return self.cell.pack(loop.state)

    def _loop(self, x, inputs, acceleration: Anderson | None) -> Loop:
        flow = self.cell.flow(inputs)
        x = self.cell.starts(inputs) if x is None else x
        first = self.cell.states_of(x, flow.inputs.shape[-1])
        return Loop(
            self.cell,
            flow,
            self.cell.fill(first, flow.inputs),
            order=self.order,
            step=self.step,
            acceleration=acceleration,
        )

    @checked
    @torch.no_grad()
    def settle(
        self,
        x: torch.Tensor | None = None,
        inputs: Mapping[str, object] | None = None,
        *,
        settling: Settling | None = None,
        limit: int = 20_000,
        check: int = 1,
        progress: Progress = silent,
        observe: Callable[[Loop, torch.Tensor, Ledger], None] | None = None,
    ) -> Settled:
        """Run until all samples have settled, stalled, diverged or left a domain.

        The run also ends when the steps are used up. A finished sample leaves the batch, and the
        others continue without it.

        Parameters
        ----------
        x : (n,) or (B, n) tensor, optional
            Initial guess; `CellLayer.starts` by default.
        inputs : mapping of input name to number, (B,) or (B, N) array, optional
            Inputs that replace those of ``network.inputs``.
        settling : Settling, optional
            Definition of a settled sample; by default a residual of 1e-6, confirmed at 0.005 of it,
            and in float32 1e-4 and 0.5.
        limit : int
            Largest number of steps.
        check : int
            Number of steps between two checks of the residuals.
        progress : Progress
            Receiver of one progress line every half second.
        observe : callable, optional
            Function called with the loop, the residuals (2, b) and the ledger at every check.

        Returns
        -------
        Settled
            Final states, codes, steps and residuals of all samples.

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist, if sizes do not agree, or if ``check`` or ``limit`` is not
            positive.
        """
        require_positive(check=check, limit=limit)
        settling = settling or _default_settling(self.cell.start.rows.dtype)
        loop = self._loop(x, inputs, self.acceleration)
        ledger, paced = Ledger(loop, ends_of(settling, limit)), Paced(progress)
        while True:
            residuals = loop.residuals()
            if observe:
                observe(loop, residuals, ledger)
            if not ledger.record(loop, residuals) or loop.done >= limit:
                return ledger.close(loop)
            try:
                paced(
                    lambda: (
                        f"step {loop.done}: {int(ledger.open.sum())} of {len(ledger.codes)} "
                        "samples still run"
                    )
                )
            except Stopped as end:
                return ledger.close(loop, stopped=str(end))
            for _ in range(min(check, limit - loop.done)):
                loop.advance()

    @checked
    def equilibrium(
        self,
        inputs: Mapping[str, object] | None = None,
        x: torch.Tensor | None = None,
        **settle,
    ) -> torch.Tensor:
        """Return settled states (B, n), differentiable by the implicit function theorem.

        The states are differentiable in the inputs. With d(x, p) = 0 at the settled point, dx/dp =
        -(dd/dx)^{-1} dd/dp: no step is unrolled, and only the final state is stored. Samples that
        did not settle are returned as nan.

        Parameters
        ----------
        inputs : mapping of input name to number or tensor, (B,) or (B, N), optional
            Inputs that replace those of ``network.inputs``.
        x : (n,) or (B, n) tensor, optional
            Initial guess.
        settle
            Further arguments of `settle`.

        Examples
        --------
        Derivative of the first control with respect to the target: 20 user units of control per
        unit of x.

        >>> from ann_dc import design, plants
        >>> network = design(plants.double_integrator(N=5)).network
        >>> target = torch.tensor([1.0], dtype=torch.float64, requires_grad=True)
        >>> layer = RecurrentLayer(network, acceleration=Anderson())
        >>> settled = layer.equilibrium({"q_d.x": target})
        >>> controls = settled[0, torch.as_tensor(network.of_population("u"))]
        >>> (controls[0] * network.neuron("u.a").scale.factor).backward()
        >>> target.grad.round().tolist()
        [20.0]

        References
        ----------
        Bai, Kolter and Koltun, Deep equilibrium models, NeurIPS 2019; Griewank and Walther,
        Evaluating Derivatives (2008), chapter 15.
        """
        end = self.settle(x, inputs, **settle)
        # those that did not settle have no derivative, and must not spoil another's
        settled = end.settled.nonzero()[:, 0]
        states = _attached(self.cell.flow(inputs).select(settled), end.states[settled])
        return torch.full_like(end.states, torch.nan).index_copy(0, settled, states)


def _default_settling(dtype: torch.dtype) -> Settling:
    return Settling() if dtype == torch.float64 else Settling(tolerance=1e-4, confirm=0.5)


def _attached(flow: Flow, x: torch.Tensor) -> torch.Tensor:
    """Return settled states (B, n), connected to the inputs and weights of ``flow``.

    Values are equal up to one Newton step. Only first derivatives are supported.
    """
    x = x.detach()
    drives = flow.layout.pack(flow.read(flow.layout.fill(x, flow.inputs)).drives)
    return x - _solve_jacobian(flow, x, drives)


def _solve_jacobian(flow: Flow, x: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """Return J^{-1} right (B, n) with J = d drive / dx at states (B, n).

    The result is differentiable in ``right`` (B, n). The factors are sparse and computed sample by
    sample, so that memory is linear in the number of neurons. Samples without a finite or regular J
    are nan.
    """
    with torch.no_grad():
        state = flow.layout.fill(x, flow.inputs)
        entries, saturated = flow.jacobian_entries(state), flow.saturated(state)
    factors = _factors(
        flow.layout.network, entries.T.cpu().double().numpy(), saturated.cpu().double().numpy()
    )
    return _Solve.apply(right, factors)  # pyright: ignore[reportReturnType]


def _factors(network: Network, entries: np.ndarray, saturated: np.ndarray) -> list[Any]:
    factors = []
    for data, limits in zip(entries, saturated):
        try:
            # a neuron at its rail stays there: its row of J is zero, and here one
            matrix = (evaluator(network).sparse(data) + sparse.diags_array(limits)).tocsc()
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
