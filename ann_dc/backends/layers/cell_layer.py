r"""Cell layer: one step of the network as a torch module.

With M the preconditioner and d the net input of the neurons, one recurrent step is the forward
Euler rule (16)-(17),

.. math:: x^{(j+1)} = x^{(j)} + h\, M\, d(x^{(j)}) ,

so that the gain of a neuron is lambda = h / tau. A switched-capacitor integrator computes the same
recurrence with lambda = C_s / C_i.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import nn

from ann_dc.backends.layers.flow import Flow
from ann_dc.backends.layers.layout import Layout
from ann_dc.backends.layers.named_rows import NamedRows
from ann_dc.backends.layers.preconditioners import Constants, PyramidLayer
from ann_dc.backends.layers.trained import CurrentLimits, trained_network
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.inputs import input_batch, start_moves
from ann_dc.network.network import Network
from ann_dc.network.waveforms import check_constant
from ann_dc.validation import checked
from ann_dc.weights.hashes import frame_hash, wiring_hash


@checked
class CellLayer(nn.Module):
    """One recurrent step of a network.

    ``state_dict`` contains ``weight.<connection>``, ``tau.<neuron>``, ``start.<neuron>`` and
    ``input.<input>``, each with one number per stage, and ``coordinator.<level>``. If gains are
    trainable, it also contains the logarithms of their factors: ``log_gain.tau.<neuron>``,
    ``log_gain.rho.<dual>`` and ``log_gain.coordinator.<level>``. Two hashes of the network are
    stored as ``_extra_state``: numbers of another wiring, or in other units, are rejected.

    Parameters
    ----------
    network : Network
        Network of the step; the layer uses its units.
    dtype : torch.dtype
        Type of the numbers: ``torch.float64`` or ``torch.float32``.
    device : str or torch.device
        Device that stores the numbers and computes steps.
    trainable : bool
        True to make the gains trainable: every time constant, every rho and every coordinator level
        gets a factor exp(theta), positive for any theta, with theta = 0 initially.

    Raises
    ------
    NetworkError
        If torch does not have ``dtype`` or ``device``.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> cell = CellLayer(network)
    >>> x = network.start_state
    >>> after = cell(torch.as_tensor(x)[None], step=0.1)
    >>> np.allclose(after[0], x + 0.1 * evaluator(network).rhs(x))
    True

    References
    ----------
    Paper equations (16), (17), corrected.
    """

    def __init__(
        self,
        network: Network,
        *,
        dtype: torch.dtype = torch.float64,
        device: str | torch.device = "cpu",
        trainable: bool = False,
    ) -> None:
        super().__init__()
        if dtype not in (torch.float32, torch.float64):
            raise NetworkError(f"dtype: expected torch.float32 or torch.float64, got {dtype!r}")
        check_device(device)
        check_constant(network.waveforms)
        self.network = network
        self.layout = Layout(network, dtype=dtype)
        tape, edges, cell = evaluator(network).tape, evaluator(network).edges, network.cell
        neurons = [neuron.name for neuron in cell.neurons]
        levels = [f"level_{j}" for j in range(len(tape.grid_starts) - 1)]
        self._duals = [(d.neuron, edges[d.path]) for d in cell.duals if d.path in edges]

        def numbers(values) -> torch.Tensor:
            return torch.as_tensor(np.array(values, float), dtype=dtype)

        tau = [np.broadcast_to(neuron.tau, network.stages) for neuron in cell.neurons]
        given = [np.broadcast_to(network.inputs[name], network.stages) for name in cell.inputs]
        self.weight = NamedRows(sorted(edges, key=edges.__getitem__), numbers(tape.weights))
        self.tau = NamedRows(neurons, numbers(tau))
        self.start = NamedRows(neurons, numbers(network.unpack(network.start_state)))
        self.input = NamedRows(cell.inputs, numbers(given).reshape(-1, network.stages))
        sizes = np.diff(tape.grid_starts).tolist()
        self.coordinator = NamedRows(levels, numbers(tape.grids), sizes=sizes)
        factors = [
            *(f"tau.{name}" for name in neurons),
            *(f"rho.{name}" for name, _ in self._duals),
            *(f"coordinator.{name}" for name in levels),
        ]
        zeros = torch.zeros(len(factors), dtype=dtype)
        self.log_gain = NamedRows(factors, zeros, trainable=True) if trainable else None
        self._limits = CurrentLimits(network, self.constants())
        self.to(device)

    def get_extra_state(self) -> torch.Tensor:
        """Return two hashes of the network for ``state_dict``, as (2, 32) bytes.

        `wiring_hash`, and `frame_hash`, which also covers units, saturation limits and a stiffness.
        """
        hashes = wiring_hash(self.network), frame_hash(self.network)
        return torch.tensor([list(bytes.fromhex(digits)) for digits in hashes], dtype=torch.uint8)

    def set_extra_state(self, state: object) -> None:
        """Raise `NetworkError` before any number is loaded if it belongs to another network."""
        own = self.get_extra_state()
        if isinstance(state, torch.Tensor) and torch.equal(state.cpu(), own):
            return
        is_wired_alike = (
            isinstance(state, torch.Tensor)
            and state.shape == own.shape
            and torch.equal(state[0].cpu(), own[0])
        )
        what = "units, limits or stiffness" if is_wired_alike else "wiring"
        raise NetworkError(
            f"state_dict: the numbers belong to a network with other {what} than "
            f"{self.network.title!r}; load them into a layer of that network"
        )

    def compile_blocks(self) -> None:
        """Fuse the blocks of a cell into a few loops with torch.compile.

        Compilation takes some 20 s once. It pays off for many thousand samples, especially on a
        GPU.
        """
        self.layout.compile_blocks()

    def constants(self) -> Constants:
        """Return weights, rates and coordinator gains, including the trained factors."""
        weights, tau, grids = self.weight.rows, self.tau.rows, self.coordinator.rows
        if self.log_gain is not None:
            on_tau, on_rho, on_grids = self.log_gain.rows.exp().split(
                [len(tau), len(self._duals), len(self.coordinator.names)]
            )
            tau = tau * on_tau[:, None]
            paths = [row for _, row in self._duals]
            rows = torch.as_tensor(paths, dtype=torch.int64, device=weights.device)
            weights = weights.index_copy(0, rows, weights[rows] * on_rho[:, None])
            if isinstance(self.layout.preconditioner, PyramidLayer):
                sizes = torch.as_tensor(self.layout.preconditioner.sizes, device=weights.device)
                grids = grids * on_grids.repeat_interleave(sizes)[:, None, None]
        return Constants(weights[:, :, None], self.layout.live / tau[:, :, None], grids)

    @checked
    def flow(self, inputs: Mapping[str, object] | None = None) -> Flow:
        """Return the flow for given inputs; gradients of input tensors are preserved.

        ``inputs`` maps names to a number, a (B,) or (B, N) array or tensor, and replaces those of
        ``network.inputs``. Raises `UnknownNameError` or `NetworkError` if an input does not exist
        or sizes do not agree.
        """
        return self.flow_of(self.layout.scaled(self._inputs(inputs or {})))

    def flow_of(self, rows: torch.Tensor) -> Flow:
        """Return the flow for inputs (I, N, B) in network units, in the order of the cell's."""
        return Flow(self.layout, self.constants(), rows, 0, self.network.stages, self._limits)

    def _inputs(self, given: Mapping[str, object]) -> torch.Tensor:
        own = self.input.rows[:, :, None]
        if not given:
            return own
        batch = len(next(iter(input_batch(self.network, _as_arrays(given)).values())))
        rows = list(own.expand(-1, -1, batch).unbind(0))
        for name, value in given.items():
            plain = value if isinstance(value, torch.Tensor) else np.array(value, float)
            row = torch.as_tensor(plain, dtype=own.dtype, device=own.device)
            if row.ndim == 1:
                row = row[:, None]
            shape = (batch, self.network.stages)
            rows[self.input.names.index(name)] = row.expand(shape).T
        return torch.stack(rows)

    def fill(self, x: torch.Tensor, inputs: torch.Tensor) -> torch.Tensor:
        """Return a state (P, N, B) from state vectors (B, n), for inputs (I, N, B)."""
        return self.layout.fill(x, inputs)

    def pack(self, state: torch.Tensor) -> torch.Tensor:
        """Return state vectors (B, n) from a state (P, N, B); see `Layout.pack`."""
        return self.layout.pack(state)

    def start_vector(self) -> torch.Tensor:
        """Return the initial values (1, n)."""
        return self.pack(self.start.rows[:, :, None])

    @checked
    def starts(self, inputs: Mapping[str, object] | None = None) -> torch.Tensor:
        """Return the initial values (B, n), with chain ends adapted to the inputs; see `flow`."""
        start = self.start_vector()
        if not inputs:
            return start
        now, own = self.flow(inputs).inputs, self.flow().inputs
        rows = {name: row for row, name in enumerate(self.network.cell.inputs)}
        for derivative in start_moves(self.network):
            row = rows[derivative.input], derivative.stage
            weight = torch.as_tensor(np.array(derivative.weight)).to(start)
            start = start + (now[row] - own[row])[:, None] * weight
        return start

    def states_of(self, x: Any, samples: int) -> torch.Tensor:
        """Return state vectors (B, n) from an (n,) or (B, n) array for B samples.

        Raises `NetworkError` if the sizes do not agree.
        """
        plain = x if isinstance(x, torch.Tensor) else np.array(x, float)
        x = torch.atleast_2d(torch.as_tensor(plain).to(self.start.rows))
        if x.ndim != 2 or x.shape[1] != self.network.size:
            raise NetworkError(
                f"x: expected state vectors of {self.network.size} neurons, got an array of "
                f"shape {tuple(x.shape)}"
            )
        if samples > 1 and len(x) not in (1, samples):
            raise NetworkError(
                f"x: sizes of the batch differ: {len(x)} states, inputs of {samples} samples"
            )
        return x.expand(max(len(x), samples), -1)

    @checked
    def forward(
        self,
        x: torch.Tensor,
        inputs: Mapping[str, object] | None = None,
        *,
        step: float | torch.Tensor,
    ) -> torch.Tensor:
        """Return the state vectors (B, n) after one step of all neurons at once.

        Parameters
        ----------
        x : (n,) or (B, n) tensor
            State vectors in network units.
        inputs : mapping of input name to number, (B,) or (B, N) array, optional
            Inputs that replace those of ``network.inputs``.
        step : float or (B,) tensor
            Step length h in units of network time.

        Raises
        ------
        NetworkError
            If the sizes do not agree.
        """
        flow = self.flow(inputs)
        state = self.fill(self.states_of(x, flow.inputs.shape[-1]), flow.inputs)
        moved = state + step * flow.derivative(flow.read(state).arriving, state)
        return self.pack(flow.within_limits(moved))

    def trained(self) -> Network:
        """Return the network with the layer's numbers, for the ODE, a circuit or a file.

        Examples
        --------
        >>> import ann_dc
        >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
        >>> cell = CellLayer(network, trainable=True)
        >>> with torch.no_grad():
        ...     _ = cell.log_gain["tau.u.a"].fill_(np.log(2.0))  # as an optimiser may
        >>> np.allclose(cell.trained().neuron("u.a").tau, 2 * network.neuron("u.a").tau)
        True
        """
        return trained_network(
            self.network, self.constants(), tau=self.tau, start=self.start, inputs=self.input
        )


def _as_arrays(values: Mapping[str, object]) -> dict[str, object]:
    """Return the values with tensors converted to arrays."""
    return {
        name: value.detach().cpu().numpy() if isinstance(value, torch.Tensor) else value
        for name, value in values.items()
    }


def check_device(device: str | torch.device) -> None:
    """Raise `NetworkError` if torch does not have a device.

    The message names the device and a remedy.
    """
    try:
        kind = torch.device(device).type
    except RuntimeError as error:
        raise NetworkError(f"device: {device!r} is unknown to torch") from error
    if kind == "cuda" and not torch.cuda.is_available():
        raise NetworkError(
            f"device: {device!r} is not available, because torch finds no CUDA device; use "
            "device='cpu', or install a torch build with CUDA on a machine with an NVIDIA GPU"
        )
