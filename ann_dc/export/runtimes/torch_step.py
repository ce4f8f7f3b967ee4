"""Step of a network as a torch module of tensors, traceable by torch.export."""

from __future__ import annotations

import torch
from torch import nn

from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.network.network import Network

EXAMPLES = 3
"""Batch size for tracing; any batch size can be run."""


class Step(nn.Module):
    """Step of `CellLayer`, and the residual before it, in float64 or float32."""

    def __init__(self, network: Network, dtype: torch.dtype) -> None:
        super().__init__()
        self.cell = CellLayer(network, dtype=dtype)
        for module in self.cell.modules():
            _with_own_tables(module)

    def forward(
        self, x: torch.Tensor, inputs: torch.Tensor, step: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """Return the state one step later and the relative KKT residual.

        The tensors are x (B, n), inputs (B, I, N) in network units, step () in network time.
        """
        layout = self.cell.layout
        flow = self.cell.flow_of(inputs.permute(1, 2, 0))
        state = layout.fill(x, flow.inputs)
        reading = flow.read(state)
        moved = state + step * flow.derivative(reading.arriving, state)
        residual = flow.residuals(state, reading.drives).amax(0)
        return {"x": layout.pack(flow.within_limits(moved)), "residual": residual}

    def examples(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return tensors for tracing: start and inputs of the network, repeated as batch."""
        cell = self.cell
        x = cell.start_vector().expand(EXAMPLES, -1).clone()
        inputs = cell.layout.scaled(cell.input.rows[:, :, None]).permute(2, 0, 1)
        return x, inputs.expand(EXAMPLES, -1, -1).clone(), x.new_tensor(0.1)


def traced(network: Network, dtype: torch.dtype) -> torch.export.ExportedProgram:
    """Return the program of a step, for batches of any size."""
    module, batch = Step(network, dtype), torch.export.Dim.DYNAMIC
    with torch.no_grad():
        return torch.export.export(
            module, module.examples(), dynamic_shapes=({0: batch}, {0: batch}, None)
        )


def _with_own_tables(module: nn.Module) -> None:
    """Replace buffers by tensors with separate storage for torch.export.save; omit empty ones."""
    for name, table in list(module.named_buffers(recurse=False)):
        if table.numel() == 0:
            delattr(module, name)
            object.__setattr__(module, name, table)
        else:
            setattr(module, name, table.clone(memory_format=torch.contiguous_format))
