"""``ann-dc run``: run of a saved or hand-wired network, in the ODE or as a circuit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ann_dc.cli.arguments.backends import RunOptions, backend_of, method_option
from ann_dc.cli.arguments.options import (
    FiguresOption,
    JsonOption,
    QuietOption,
    TrajectoryOption,
    argument,
    completing,
    option,
    timed,
)
from ann_dc.cli.arguments.saved_network import (
    NetworkOptions,
    check_duration,
    is_network,
    saved_network,
)
from ann_dc.cli.arguments.words import LEVELS, LevelOptions, MarginOption, level_of, levels_known
from ann_dc.cli.terminal import finish, notes, progress_line
from ann_dc.errors import ProblemError
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room

ODE = "ode"
"""Model that is not a circuit: the equations of the network."""


@dataclass(frozen=True, kw_only=True)
class ModelOptions(LevelOptions):
    """Model of the network: its ODE, or a circuit in ngspice."""

    level: str = option(
        f"ode (the ideal network), or a circuit in ngspice. {LEVELS}",
        default=ODE,
        metavar="LEVEL",
        autocompletion=completing(lambda: [ODE, *levels_known()]),
    )
    bandwidth_margin: MarginOption = None
    method: str | None = method_option()

    @property
    def is_circuit(self) -> bool:
        """True if the network runs as a circuit."""
        return self.level.lower() != ODE

    def check(self) -> None:
        """Raise `ProblemError` for an option that the model does not have."""
        if self.is_circuit and self.method is not None:
            raise ProblemError("--method: applies to the ODE; omit it, or omit --level")
        circuit = {**self.op_amps(), "area": self.area, "bandwidth-margin": self.bandwidth_margin}
        for name, value in circuit.items():
            if not self.is_circuit and value is not None:
                raise ProblemError(f"--{name}: applies to a circuit; add --level macro")


@timed
def run(
    *,
    network: str = argument(
        "Weight file (.npz, .safetensors), export to weights, or folder of a saved solution.",
        metavar="NETWORK_FILE",
    ),
    given: NetworkOptions,
    model: ModelOptions,
    figures: FiguresOption = None,
    trajectory: TrajectoryOption = None,
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a saved network, designed or wired by hand: its ODE, or a circuit.

    The network starts from its saved initial state and runs until it settles,
    or for the --duration given: an oscillator or a chaotic network never
    settles. With --level it is built as a circuit, simulated in ngspice from
    reset, and compared with the ODE. Circuits are scaled by the run of the
    ODE. Write a network wired in Python with ann_dc.save(network, FILE).

    Usage examples:

      ann-dc run network.npz
      ann-dc run network.npz --input q_d.x=3 --trajectory out/moved.csv
      ann-dc run network.npz --input q_d.x=target.csv:x --duration 500
      ann-dc run oscillator.npz --duration 30 --figures out
      ann-dc run oscillator.npz --duration 30 --level macro --json out/macro.json
      ann-dc run stiff.npz --method Radau
      ann-dc export oscillator.npz --to pack --duration 30

    Predictions, parts, noise and tolerances of its circuit: ann-dc circuit.

    Exit code: 0 settled, or the duration completed; 1 neither; 2 bad input, a
    circuit that cannot be built, ngspice not found, or unwritable output.
    """
    with notes(quiet), progress_line(quiet) as progress:
        check_duration(given.duration)
        model.check()
        make_room(json_file, figures=figures, trajectory=trajectory)
        found = given.applied_to(_network(network))

        from ann_dc.report.network_run import NetworkRunReport

        backend, name = _backend(model, found, given.duration, progress)
        done = backend.run(found)
        report = NetworkRunReport(network=found, run=done, model=name, duration=given.duration)
        tables, written = report.tables(), report.write(figures, trajectory, json_file)
    finish(tables, written, quiet=quiet, code=0 if report.good else 1)


def _network(word: str):
    """Return the network of NETWORK_FILE."""
    if not is_network(word):
        raise ProblemError(
            "NETWORK_FILE: expected a weight file (.npz, .safetensors) or the folder of an "
            f"export to weights, got {word!r}; for a plant or a .toml problem use: ann-dc solve "
            f"{word}"
        )
    return saved_network(word)


def _backend(model: ModelOptions, network: Any, duration: float | None, progress: Progress):
    """Return the backend of --level or --method, and the name of its model."""
    if not model.is_circuit:
        ode = backend_of("ode", RunOptions(method=model.method), progress=progress)
        return replace(ode, duration=duration), f"ODE, {ode.method.name}"

    from ann_dc.cli.arguments.building import circuit_backend

    backend = circuit_backend(
        network,
        level_of(model)(network),
        duration=duration,
        bandwidth_margin=model.bandwidth_margin,
        progress=progress,
    )
    return backend, f"circuit, {backend.level.name}"
