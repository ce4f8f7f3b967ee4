"""Evaluation of one state in torch, with the interface of all evaluators.

Runs use a `Flow` for many samples at once. This evaluator applies the same flow to one state, so
that the common test suite can compare torch with NumPy and the compiled loops.
"""

from __future__ import annotations

from typing import final

import numpy as np
import torch

from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network


@final
class TorchEvaluator(Evaluator):
    """Evaluator of one network in torch.

    The type ``dtype`` is ``torch.float64`` or ``torch.float32``; `NetworkError` is raised for
    another type.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    >>> x = network.start_state
    >>> np.allclose(TorchEvaluator(network).rhs(x), ann_dc.evaluator(network).rhs(x))
    True
    """

    def __init__(self, network: Network, *, dtype: torch.dtype = torch.float64) -> None:
        super().__init__(network, evaluator(network).tape)
        self.flow = CellLayer(network, dtype=dtype).flow()
        self._dtype = dtype

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the values (nodes, N + 2) of every node."""
        values = self.tape.values.copy()
        flow, state = self.flow, self._state(x)
        nodes, _ = flow.layout.tape.evaluate(flow.constants.weights, flow.inputs, state)
        for row, node in enumerate(nodes):
            values[row, 1:-1] = node[:, 0]
        return values

    def drives(self, x: np.ndarray) -> np.ndarray:
        """Return the net input of every neuron, (neurons, N)."""
        return self.flow.read(self._state(x)).drives[:, :, 0].numpy()

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """Return dx/ds (n,) in network units."""
        state = self._state(x)
        derivatives = self.flow.derivative(self.flow.read(state).arriving, state)
        return self.flow.layout.pack(derivatives)[0].numpy()

    def derivative(self, drive: np.ndarray) -> np.ndarray:
        """Return M drive, both (n,)."""
        layout, vector = self.flow.layout, torch.as_tensor(np.array(drive), dtype=self._dtype)
        drives = layout.fill(vector[None], self.flow.inputs) * layout.live
        return layout.pack(layout.preconditioner(self.flow.constants, drives))[0].numpy()

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Return the relative (constraint, stationarity) residuals."""
        state = self._state(x)
        constraint, stationarity = self.flow.residuals(state, self.flow.read(state).drives)
        return float(constraint), float(stationarity)

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Return the entries of d drive / dx (nnz,); zero at a saturation limit."""
        return self.flow.jacobian_entries(self._state(x))[:, 0].numpy()

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """Return (block, stage) of the first function block outside its domain.

        The result is (-1, -1) if all function blocks are inside their domains.
        """
        arguments = self.flow.read(self._state(x)).arguments
        guarded = self.flow.layout.tape.guarded
        signs = [torch.as_tensor(guard.signs[block])[:, None] for block, _, _ in guarded]
        for (block, _, _), defined in zip(guarded, self.flow.defined(arguments, signs)):
            if not defined.all():
                return block, int(defined[:, 0].expand(self.network.stages).int().argmin())
        return -1, -1

    def _state(self, x: np.ndarray) -> torch.Tensor:
        vector = torch.as_tensor(np.array(x, float), dtype=self._dtype)
        return self.flow.layout.fill(vector[None], self.flow.inputs)
