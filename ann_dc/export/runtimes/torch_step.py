"""One step of a network as a torch module of tensors alone, which torch.export can trace."""

from __future__ import annotations

import torch
from torch import nn

from ann_dc.backends.recurrent.cell.layer import CellLayer
from ann_dc.network.network import Network

EXAMPLES = 3
"""Samples of the batch that is traced; any number can be run."""


class Step(nn.Module):
    """A step as `CellLayer` takes it, and the residual before it.

    Parameters
    ----------
    network : Network
    dtype : torch.dtype
        ``torch.float64`` or ``torch.float32``.
    """

    def __init__(self, network: Network, dtype: torch.dtype) -> None:
        super().__init__()
        self.cell = CellLayer(network, dtype=dtype)
        for module in self.cell.modules():
            _with_own_tables(module)

    def forward(
        self, x: torch.Tensor, inputs: torch.Tensor, step: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """The state a step later, and the relative KKT residual.

        Parameters
        ----------
        x : (B, n) tensor
        inputs : (B, I, N) tensor
            In network units.
        step : () tensor
            h, in units of network time.
        """
        layout = self.cell.layout
        flow = self.cell.flow_of(inputs.permute(1, 2, 0))
        state = layout.fill(x, flow.inputs)
        reading = flow.read(state)
        moved = state + step * flow.move(reading.arriving, state)
        residual = flow.residuals(state, reading.drives).amax(0)
        return {"x": layout.pack(flow.within_rails(moved)), "residual": residual}

    def examples(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Tensors to trace with: the network's start and inputs, some times."""
        cell = self.cell
        x = cell.start_vector().expand(EXAMPLES, -1).clone()
        inputs = cell.layout.scaled(cell.input.rows[:, :, None]).permute(2, 0, 1)
        return x, inputs.expand(EXAMPLES, -1, -1).clone(), x.new_tensor(0.1)


def traced(network: Network, dtype: torch.dtype) -> torch.export.ExportedProgram:
    """The program of a step, for batches of any size.

    Parameters
    ----------
    network : Network
    dtype : torch.dtype
    """
    module, batch = Step(network, dtype), torch.export.Dim.DYNAMIC
    with torch.no_grad():
        return torch.export.export(
            module, module.examples(), dynamic_shapes=({0: batch}, {0: batch}, None)
        )


def _with_own_tables(module: nn.Module) -> None:
    """Buffers that torch.export.save can write: each whole, with storage of its own.

    One without elements becomes a plain attribute, of which nothing is written.
    """
    for name, table in list(module.named_buffers(recurse=False)):
        if table.numel() == 0:
            delattr(module, name)
            object.__setattr__(module, name, table)
        else:
            setattr(module, name, table.clone(memory_format=torch.contiguous_format))
