"""Recurrent layer: many steps of a network, for each sample until it has settled.

A layer runs a batch in three ways. `RecurrentLayer.forward` unrolls a number of steps and is
differentiable. `RecurrentLayer.settle` continues until every sample has settled or failed.
`RecurrentLayer.equilibrium` returns the settled point as a differentiable function of the inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from torch import nn

from ann_dc.backends.recurrent.cell.layer import CellLayer
from ann_dc.backends.recurrent.layers.equilibrium import attached
from ann_dc.backends.recurrent.layers.ledger import Ledger, Settled
from ann_dc.backends.recurrent.layers.loop import Loop
from ann_dc.backends.recurrent.rules.acceleration import Anderson
from ann_dc.backends.recurrent.rules.orders import SIMULTANEOUS, Order, check_order
from ann_dc.backends.recurrent.rules.steps import AdaptiveStep, StepRule
from ann_dc.backends.settling import Settling, window_of
from ann_dc.errors import require_positive
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
        ledger, paced = Ledger(loop, settling, check, window_of(limit)), Paced(progress)
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
                        "samples run on"
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
        states = attached(self.cell.flow(inputs).select(settled), end.states[settled])
        return torch.full_like(end.states, torch.nan).index_copy(0, settled, states)


def _default_settling(dtype: torch.dtype) -> Settling:
    return Settling() if dtype == torch.float64 else Settling(tolerance=1e-4, confirm=0.5)
