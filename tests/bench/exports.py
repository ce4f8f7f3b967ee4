"""Exports: time and size of writing, and speed of what was exported.

In onnxruntime the loop to settling runs beside the recurrent layer in torch and beside
`RecurrentBackend`, which has generated code: the same cars (as in bench `batch`), with the same
fixed step, each until its residual is first below 1e-6; in float32 1e-4. All on one thread, in CPU
seconds, the least of three.
"""

import argparse
import time
from collections.abc import Callable, Iterator

import numpy as np
import onnxruntime
import torch
from bench.batch import random_cars
from bench.figure import Figure, show

import ann_dc
from ann_dc.export.onnx.files import onnx_files
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.network.inputs import input_batch, moved_starts

CARS = (1, 64, 1024)
STAGES = (9, 90)
REPEATS = 3
TOLERANCES = {"float64": 1e-6, "float32": 1e-4}
SAME = {"float64": 1.0, "float32": 0.99}
"""Share of the cars that have to settle after as many steps as in the layer."""


def least(call: Callable[[], object]) -> float:
    """CPU seconds of a call."""
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return min(times)


def written(stages: int) -> Figure:
    """Seconds and bytes of the car's ONNX files."""
    network = ann_dc.design(ann_dc.plants.car(N=stages)).network
    vector = reference_vector(network)
    seconds = least(lambda: onnx_files(network, vector))
    sizes = {name: len(content) for name, content in onnx_files(network, vector).items()}
    return Figure(
        name=f"car, N = {stages}: ONNX written",
        value=f"{seconds:.2f} s",
        remark=", ".join(f"{name} {size / 1e3:.0f} kB" for name, size in sorted(sizes.items())),
        good=seconds < 5,
    )


class Runner:
    """The loop to settling of a network in onnxruntime."""

    def __init__(self, network: ann_dc.Network, vector: ReferenceVector, precision: str) -> None:
        self.network, self.precision, self.step = network, precision, vector.step
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        content = onnx_files(network, vector, precision=precision)["settle.onnx"]
        self.session = onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"]
        )

    def given(self, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What the model is given for inputs (B,) each."""
        network, every = self.network, input_batch(self.network, inputs)
        states = np.moveaxis(network.unpack(moved_starts(network, every)), 0, -1)
        rows = [network.input_scale(name).network(every[name]) for name in network.cell.inputs]
        shape = states.shape[-1], network.stages
        numbers = {
            "states": states,
            "inputs": np.array([np.broadcast_to(row, shape).T for row in rows]),
            "step": self.step,
            "tolerance": TOLERANCES[self.precision],
        }
        given = {name: np.array(values, self.precision) for name, values in numbers.items()}
        return given | {"limit": np.array(20_000)}


def compared(network: ann_dc.Network, vector: ReferenceVector, count: int) -> Iterator[Figure]:
    """The same cars in torch, in generated code and in onnxruntime."""
    inputs, rule = random_cars(count), ann_dc.FixedStep(step=vector.step)
    settling = {p: ann_dc.Settling(tolerance=t, confirm=1.0) for p, t in TOLERANCES.items()}
    layer = ann_dc.RecurrentLayer(network, step=rule)
    ends = {p: layer.settle(inputs=inputs, settling=s) for p, s in settling.items()}
    beside = least(lambda: layer.settle(inputs=inputs, settling=settling["float64"]))
    yield Figure(
        name=f"{count} cars, torch layer",
        value=f"{beside:.3g} s",
        remark=f"{int(ends['float64'].settled.sum())} settled",
    )
    backend = ann_dc.RecurrentBackend(step=rule, settling=settling["float64"])
    seconds = least(lambda: backend.run_batch(network, inputs))
    yield Figure(name=f"{count} cars, RecurrentBackend", value=f"{seconds:.3g} s")
    for precision in TOLERANCES:
        runner = Runner(network, vector, precision)
        given = runner.given(inputs)
        seconds = least(lambda: runner.session.run(None, given))  # noqa: B023
        _, residual, steps = runner.session.run(None, given)
        same = np.mean(steps == ends[precision].steps.numpy())
        settled = int((residual < TOLERANCES[precision]).sum())
        yield Figure(
            name=f"{count} cars, onnxruntime {precision}",
            value=f"{seconds:.3g} s",
            remark=f"{settled} settled, {same:.1%} after as many steps as the layer in float64",
            good=seconds <= beside and settled == count and same >= SAME[precision],
        )


def figures() -> Iterator[Figure]:
    """Writing first."""
    torch.set_num_threads(1)
    yield from map(written, STAGES)
    network = ann_dc.design(
        ann_dc.plants.car(), preconditioner=ann_dc.RecurrentBackend().kinds
    ).network
    vector = reference_vector(network)
    for count in CARS:
        yield from compared(network, vector, count)


def main() -> int:
    """Show every figure."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    return show(figures())


if __name__ == "__main__":
    raise SystemExit(main())
