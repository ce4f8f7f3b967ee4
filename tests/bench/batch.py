"""Batches of 1024 cars: networks per second, against single runs and diffrax.

Each car has another start and another target. `run_batch` of either backend runs them in generated
code, a recurrent layer in tensors; `OdeBackend` runs some of them one by one; diffrax integrates
the same flow, written from the tape with jax.numpy and vmapped, to the network time at which the
recurrence had settled all of them. It is left out where it is not installed
(``pip install 'ann-dc[bench]'``).

Settled means what each backend means by it (a residual of 5e-9; in float32 5e-5), and for diffrax a
residual below 1e-6 at the end. Seconds are CPU seconds on one core, so that other processes count
little, and wall seconds on a GPU, where batches of 1e3 to 1e5 run if there is one. The share of the
bandwidth is what a step reads and writes, tensor by tensor, over what a plain copy moves.
"""

import argparse
import importlib.util
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import torch
import torch._dynamo
from bench.figure import Figure, show
from bench.jax_flow import jax_flow

import ann_dc
from ann_dc.backends.layers.preconditioners import EliminationLayer, PyramidLayer
from ann_dc.backends.layers.tape import TorchTape
from ann_dc.backends.recurrent.backend import CHECK, CHECK_ON_GPU
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import FUNCTION, PRODUCT, SUM
from ann_dc.network.inputs import input_batch, moved_starts

CARS = 1024
ONE_BY_ONE = 40
GPU_CARS = (1_000, 10_000, 100_000)
REPEATS = 3
BACKENDS = {
    "RecurrentBackend().run_batch": ann_dc.RecurrentBackend(),
    "OdeBackend().run_batch": ann_dc.OdeBackend(),
    "OdeBackend().run_batch, rtol 1e-6": ann_dc.OdeBackend(method=ann_dc.ode.BATCHES.tighter(10)),
}
"""In generated code, the recurrence first."""


@dataclass(frozen=True, kw_only=True)
class ArrayLayout:
    """A line of the table."""

    name: str
    cars: int
    settled: int
    seconds: float
    residual: float
    """Largest at the end of those that settled."""
    first: float = float("nan")
    """Wall seconds of the first call, which compiles."""
    steps: str = ""
    share: float = float("nan")
    """Of the memory bandwidth."""

    def figure(self) -> Figure:
        """The row as a measured figure."""
        parts = [
            f"{self.settled} of {self.cars} settled",
            f"{1e3 * self.seconds / self.cars:.3f} ms each",
            f"residual {self.residual:.1e}",
            f"first call {self.first:.1f} s" if self.first == self.first else "",
            f"{self.share:.0%} of the bandwidth" if self.share == self.share else "",
            f"steps {self.steps} (median, most)" if self.steps else "",
        ]
        return Figure(
            name=f"{self.cars} cars, {self.name}",
            value=f"{self.cars / self.seconds:.1f} networks/s",
            remark="; ".join(filter(None, parts)),
        )


def random_cars(count: int) -> dict[str, np.ndarray]:
    """Inputs of that many cars."""
    rng = np.random.default_rng(0)
    start = {name: rng.uniform(-0.5, 0.5, count) for name in ("q_0.x", "q_0.y")}
    target = {name: rng.uniform(4, 6, count) for name in ("q_d.x", "q_d.y")}
    return {**start, "q_0.phi": rng.uniform(-0.2, 0.2, count), **target}


def measured(call: Callable[[], object], clock=time.process_time, repeats: int = REPEATS) -> float:
    """Median seconds of a call."""
    times = []
    for _ in range(repeats):
        began = clock()
        call()
        times.append(clock() - began)
    return float(np.median(times))


def layers(network: ann_dc.Network, device: str) -> Iterator[tuple[str, ann_dc.RecurrentLayer]]:
    """Every kind of layer, with its name; the blocks of a layer are compiled once."""
    for dtype, name in ((torch.float64, "float64"), (torch.float32, "float32 to 1e-4")):
        for compiled in (False, True):
            layer = ann_dc.RecurrentLayer(network, dtype=dtype, device=device)
            if compiled:
                layer.cell.compile_blocks()
            kind = f"{device} {name}{' compiled' if compiled else ''}"
            yield kind, layer
            layer.step = ann_dc.AdaptiveStep(share=0.9, first=0.3)  # as the backend has it
            layer.acceleration = ann_dc.Anderson()
            yield f"{kind} Anderson", layer


def recurrent_row(name: str, layer: ann_dc.RecurrentLayer, inputs, bandwidth: float) -> ArrayLayout:
    """A batch through a layer."""
    on_gpu = layer.cell.layout.live.is_cuda
    check = CHECK_ON_GPU if on_gpu else CHECK
    sample_steps: list[int] = []

    def timed() -> None:
        layer.settle(inputs=inputs, check=check)
        if on_gpu:
            torch.cuda.synchronize()

    began = time.perf_counter()
    ended = layer.settle(
        inputs=inputs,
        check=check,
        observe=lambda loop, *_: sample_steps.append(check * loop.state.shape[-1]),
    )
    first = time.perf_counter() - began
    seconds = measured(timed, time.perf_counter if on_gpu else time.process_time)
    moved = sum(sample_steps[:-1]) * bytes_a_step(layer, "compiled" in name)
    done = ended.settled.cpu().numpy()
    steps = ended.settling_steps.cpu().numpy()[done]
    return ArrayLayout(
        name=name,
        cars=len(done),
        settled=int(done.sum()),
        seconds=seconds,
        residual=float(ended.residuals.amax(0)[ended.settled].max()),
        first=first if "compiled" in name else float("nan"),
        share=moved / seconds / bandwidth,
        steps=f"{np.median(steps):.0f}, {steps.max()}" if done.any() else "",
    )


def bytes_a_step(layer: ann_dc.RecurrentLayer, compiled: bool) -> int:
    """What a step of one sample reads and writes, estimated; compiled blocks keep to the ends."""
    cell, wiring = layer.cell.layout, layer.cell.layout.tape
    neurons = wiring.neurons
    rows = 2 * neurons if compiled else _rows_of_blocks(wiring)
    rows += 16 * neurons  # rails, rates, energy, the step itself
    if isinstance(cell.preconditioner, PyramidLayer):
        rows += 4 * neurons + 6 * len(cell.network.cell.chains)
    if isinstance(
        cell.preconditioner, EliminationLayer
    ):  # down, up, and the square roots on either side
        rows += 8 * len(cell.primal)
    if layer.acceleration is not None:  # dF twice for the gram and gamma, dF and dX for the step
        rows += (4 * layer.acceleration.memory + 20) * neurons
    return rows * cell.network.stages * cell.live.element_size()


def _rows_of_blocks(wiring: TorchTape) -> int:
    """Rows that eager blocks read and write: three a sum's term or a product, two a function."""
    rows, shifts = 4 * wiring.neurons, {tuple(s) for s in wiring.sources if s[1] != 0}
    for kind, _, a, b in wiring.blocks:
        rows += {SUM: 3 * (b - a) - 1, PRODUCT: 3, FUNCTION: 2}[kind]
    return rows + sum(3 * (last - first) - 1 for first, last in wiring.drives) + 2 * len(shifts)


def bandwidth_of(device: str, size: int = 1 << 26) -> float:
    """Bytes a second that a copy of a large tensor reads and writes."""
    source = torch.ones(size, device=device)
    target = torch.empty_like(source)

    def copy() -> None:
        target.copy_(source)
        if source.is_cuda:
            torch.cuda.synchronize()

    copy()
    clock = time.perf_counter if source.is_cuda else time.process_time
    return 2 * source.nbytes / measured(copy, clock, 9)


def ode_rows(networks: list[ann_dc.Network]) -> Iterator[ArrayLayout]:
    """Each network by itself in continuous time."""
    for method in (ann_dc.ode.RK45, ann_dc.ode.DOP853):
        for verify in (False, True):
            backend = ann_dc.OdeBackend(method=method, verify=verify)
            backend.run(networks[0])  # the kernel is compiled, or read from disk
            began = time.process_time()
            runs = [backend.run(network) for network in networks]
            seconds = time.process_time() - began
            done = [run for run in runs if run.status.settled]
            steps = [run.steps for run in done]
            yield ArrayLayout(
                name=f"OdeBackend {method.name}{' verified' if verify else ''}",
                cars=len(runs),
                settled=len(done),
                seconds=seconds,
                residual=max(run.trajectory.kkt[-1] for run in done),
                steps=f"{np.median(steps):.0f}, {max(steps)}",
            )


def diffrax_rows(network, inputs, end: float, states: np.ndarray) -> Iterator[ArrayLayout]:
    """diffrax's Tsit5 under vmap, all cars and a quarter of them; tells whether it agrees."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    every = input_batch(network, inputs)
    starts = moved_starts(network, every)
    given = np.stack([every[name] for name in network.cell.inputs], axis=1)
    flow = jax_flow(network)
    error = np.abs(
        np.array(flow(starts[0], given[0])) - evaluator(car_of(network, inputs, 0)).rhs(starts[0])
    )
    assert error.max() < 1e-10 * np.abs(starts[0]).max(), "the jax graph is another network"

    def solve(x, inputs, rtol, atol):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(lambda _, x, inputs: flow(x, inputs)),
            diffrax.Tsit5(),
            t0=0.0,
            t1=end,
            dt0=None,
            y0=x,
            args=inputs,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol),
            max_steps=100_000,
            throw=False,
        )

    many = jax.jit(jax.vmap(solve, in_axes=(0, 0, None, None)))
    for count, rtol, atol in ((64, 1e-10, 1e-13), (len(starts) // 4, 1e-6, 1e-10),
                              (len(starts), 1e-6, 1e-10)):  # fmt: skip
        x, inputs_, tolerances = jnp.array(starts[:count]), jnp.array(given[:count]), (rtol, atol)
        call = lambda: many(x, inputs_, *tolerances).ys.block_until_ready()  # noqa: B023, E731
        began = time.perf_counter()
        found = many(x, inputs_, *tolerances)
        final = np.array(found.ys[:, 0])
        first = time.perf_counter() - began
        apart = np.abs(final - states[:count]).max(1) / np.abs(states[:count]).max(1)
        cars = [InterpretedEvaluator(car_of(network, inputs, i)) for i in range(count)]
        worst = np.array([max(car.residuals(x)) for car, x in zip(cars, final)])
        steps = np.array(found.stats["num_steps"])
        yield ArrayLayout(
            name=f"diffrax Tsit5 {rtol:g} {atol:g}",
            cars=count,
            settled=int((worst < 1e-6).sum()),
            seconds=measured(call, repeats=1 if rtol < 1e-6 else REPEATS),
            residual=float(worst.max()),
            first=first,
            steps=f"{np.median(steps):.0f}, {steps.max()}; apart from the recurrence by "
            f"{np.median(apart):.0e} (median), {apart.max():.0e} (most), "
            f"{(apart < 1e-6).sum()} below 1e-6",
        )


def car_of(network: ann_dc.Network, inputs, sample: int) -> ann_dc.Network:
    """The network of one car, from its own start."""
    one = {name: values[sample : sample + 1] for name, values in inputs.items()}
    start = moved_starts(network, input_batch(network, one))[0]
    return network.with_inputs({name: v[0] for name, v in one.items()}).with_start(start)


def settled_time(network, inputs) -> float:
    """Network time at which the last car of a batch had settled."""
    times: list[float] = []
    ann_dc.RecurrentLayer(network).settle(
        inputs=inputs, check=CHECK, observe=lambda loop, *_: times.append(float(loop.time.max()))
    )
    return times[-1]


def backend_row(name: str, backend, network, inputs, clock=time.process_time):
    """A batch through a backend, and its states."""
    run = backend.run_batch(network, inputs)
    print(f"{name}: {run}")
    steps = run.settling_steps[run.settled]
    row = ArrayLayout(
        name=name,
        cars=len(run),
        settled=int(run.settled.sum()),
        seconds=measured(lambda: backend.run_batch(network, inputs), clock),
        residual=float(run.residuals[run.settled].max()),
        steps=f"{np.median(steps):.0f}, {steps.max()}",
    )
    return row, run.states


def on_cpu(network, count: int) -> Iterator[ArrayLayout]:
    """The rows of one core."""
    inputs = random_cars(count)
    runs = [backend_row(name, backend, network, inputs) for name, backend in BACKENDS.items()]
    yield from (row for row, _ in runs)
    bandwidth = bandwidth_of("cpu")
    for name, layer in layers(network, "cpu"):
        yield recurrent_row(name, layer, inputs, bandwidth)
    yield from ode_rows([car_of(network, inputs, i) for i in range(min(ONE_BY_ONE, count))])
    if importlib.util.find_spec("jax") is None or importlib.util.find_spec("diffrax") is None:
        print("diffrax is left out: pip install 'ann-dc[bench]'")
        return
    yield from diffrax_rows(network, inputs, settled_time(network, inputs), runs[0][1])


def on_gpu(network, counts: tuple[int, ...]) -> Iterator[ArrayLayout]:
    """The rows of the GPU."""
    bandwidth = bandwidth_of("cuda", 1 << 28)
    print(f"{torch.cuda.get_device_name()}: a copy moves {bandwidth / 1e9:.0f} GB/s")
    for count in counts:
        inputs = random_cars(count)
        for name, layer in layers(network, "cuda"):
            try:
                yield recurrent_row(name, layer, inputs, bandwidth)
            except torch.OutOfMemoryError:
                print(f"{name}: {count} cars do not fit", flush=True)


def figures(cars: int = CARS) -> Iterator[Figure]:
    """One a way, on one core, and on the GPU where there is one."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    torch.set_num_threads(1)
    # Every dtype, layout and batch of one counts; above 8 torch would go on in eager mode.
    torch._dynamo.config.recompile_limit = 64
    kinds = ann_dc.RecurrentBackend().kinds  # what suits the simultaneous order
    network = ann_dc.design(ann_dc.plants.car(), preconditioner=kinds).network
    for row in on_cpu(network, cars):
        yield row.figure()
    os.sched_setaffinity(0, cores)
    for name, backend in BACKENDS.items():
        name = f"{name}, {len(cores)} cores, wall"
        row, _ = backend_row(name, backend, network, random_cars(cars), time.perf_counter)
        yield row.figure()
    if torch.cuda.is_available():
        for row in on_gpu(network, GPU_CARS):
            yield row.figure()


def main() -> int:
    """Show every figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cars", nargs="?", type=int, default=CARS)
    return show(figures(parser.parse_args().cars))


if __name__ == "__main__":
    raise SystemExit(main())
