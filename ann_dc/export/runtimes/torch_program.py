"""Step of a network as a `torch.export` program: a file that torch runs alone.

The program maps ``x`` (B, n), ``inputs`` (B, I, N) and ``step`` () to ``x`` one step later and the
``residual`` (B,) before it, for any B. ``torch_program.json`` names the components, the inputs, and
the rows of the tensors in the program.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.export.reference.contents import package
from ann_dc.export.reference.sidecar import Beside, check_vector, notes_on, read_beside
from ann_dc.export.reference.vector import TOLERANCES, VECTOR, Precision, ReferenceVector, compare
from ann_dc.network.network import Network
from ann_dc.validation import checked

if TYPE_CHECKING:
    import torch

FORMAT = "ann_dc torch program"
SCHEMA = 1
PROGRAM, NOTES = "torch_program.pt2", "torch_program.json"
BATCHES = (1, 3, 64)
"""Batch sizes of a check."""


@checked
def torch_program_files(
    network: Network, vector: ReferenceVector, *, precision: Precision = "float64"
) -> dict[str, bytes]:
    """Export one step of a network as a program for `torch.export.load`.

    The ``precision`` is ``float64`` or ``float32``. Raises `ExportError` if the vector belongs to
    another network, and `ExportPackageMissing` if torch is not installed.
    """
    check_vector(network, vector)
    torch = package("torch", "torch")
    from ann_dc.export.runtimes.torch_step import traced

    program, stream = traced(network, getattr(torch, precision)), io.BytesIO()
    torch.export.save(program, stream)
    content = stream.getvalue()
    notes = {
        "format": FORMAT,
        "schema": SCHEMA,
        "torch": str(torch.__version__),
        "precision": precision,
        "takes": {"x": "(B, n)", "inputs": "(B, I, N), network units", "step": "()"},
        "gives": {"x": "(B, n), a step later", "residual": "(B,), before it"},
        "x": [network.label(i) for i in range(network.size)],
        **notes_on(network, vector, content),
        "tensors": _rows_of(network, program.state_dict),
    }
    return {PROGRAM: content, NOTES: (json.dumps(notes) + "\n").encode(), VECTOR: vector.as_json()}


@checked
def torch_program_check(files: Mapping[str, bytes]) -> str:
    """Load a program and repeat the steps of the test vector at several batch sizes.

    `torch.export.load` may run code hidden in a file. A program is therefore loaded only if its
    hash is the one in ``torch_program.json``. The hash detects every change, but not a malicious
    pair of files, so check only files from trusted sources.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing or changed, or
    the program takes different steps.
    """
    beside = read_beside(files, PROGRAM, NOTES, FORMAT, SCHEMA)
    vector, precision = beside.vector, beside.notes.choice("precision", _PRECISIONS)
    walker = _Walker(_loaded(files[PROGRAM]), precision, beside)
    worst = max(compare(vector, walker.of_batch(size), precision) for size in BATCHES)
    off = abs(walker.residual(vector.end) - vector.residual)
    if not off <= TOLERANCES[precision]:
        raise FileFormatError(
            f"{PROGRAM}: the residual at the end of {VECTOR} differs by {off:.1e} from the "
            "stored one; export the network again"
        )
    sizes = ", ".join(map(str, BATCHES))
    return (
        f"{max(vector.early)} steps in torch within {worst:.0e} of the reference vector, at "
        f"batches of {sizes}; the residual at its end within {off:.0e}"
    )


_PRECISIONS: dict[str, Precision] = {name: name for name in TOLERANCES}


class _Walker:
    """Steps of a loaded program, from a start of the vector's shape."""

    def __init__(self, program, precision: Precision, beside: Beside) -> None:
        self.program, self.places, self.vector = program, beside.places, beside.vector
        self.torch, self.inputs = package("torch", "torch"), beside.inputs
        self.dtype = getattr(self.torch, precision)

    def of_batch(self, size: int):
        """Return the function that steps a batch of equal samples and returns the last."""

        def walk(start: np.ndarray, count: int) -> np.ndarray:
            x = self._tensor(self.places.pack(start), size)
            for _ in range(count):
                x = self._step(x)["x"]
            return self.places.unpack(x[-1].double().numpy(), self.vector.start)

        return walk

    def residual(self, states: np.ndarray) -> float:
        """Return the program's residual at states (P, N)."""
        return float(self._step(self._tensor(self.places.pack(states), 1))["residual"][0])

    def _step(self, x: torch.Tensor) -> Mapping[str, torch.Tensor]:
        step = self.torch.tensor(self.vector.step, dtype=self.dtype)
        with self.torch.no_grad():
            return self.program(x, self._tensor(self.inputs, len(x)), step)

    def _tensor(self, values: np.ndarray, size: int) -> torch.Tensor:
        return self.torch.as_tensor(np.array([values] * size)).to(self.dtype)


def _loaded(content: bytes):
    torch = package("torch", "torch")
    try:
        return torch.export.load(io.BytesIO(content)).module()
    except Exception as error:  # whatever a version of torch makes of another one's file
        raise FileFormatError(f"{PROGRAM}: torch {torch.__version__}: {error}") from error


def _rows_of(network: Network, held: Mapping[str, object]) -> dict[str, list[str]]:
    """Return the row names of the tensors in a program."""
    from ann_dc.backends.layers.cell_layer import CellLayer

    layer = CellLayer(network)
    parts = ("weight", "tau", "start", "input", "coordinator")
    names = {f"cell.{part}.rows": getattr(layer, part).names for part in parts}
    return {name: rows for name, rows in names.items() if name in held}
