"""Export: rounding and size of every format.

Question: Which accuracy does each export format lose?
Answer:   Digits, if the format rounds. Controls are within 0.1 % from words of 13 bits, 4096 levels
          of a conductance or 1024 units of a capacitor on; single sizes below may be accurate by
          chance. One more bit or twice the levels halves the error; twice the units divide it by
          2.6. Below 10 bits tan(varphi) does not fit; below 8 levels nothing settles. Without
          rounding (weight file, ONNX, torch, exact conductances) controls agree within 1e-11. In
          ngspice the netlist of op amps has a control error of 2.7e-5; C with words of 16 bits has
          8.3e-5. A format takes 20 to 900 kB and less than a second, a torch program about 5 s. NIR
          supports linear nodes only.
Figure:   out/demos/26_export.png
"""

from __future__ import annotations

import csv
import json
import subprocess
import tempfile
import textwrap
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

import ann_dc
from ann_dc import plotting
from ann_dc.errors import ExportError, ExportPackageMissing
from ann_dc.export import FORMATS
from ann_dc.export.devices import capacitors_files, conductances_files, weights_of
from ann_dc.export.fixed_point import fixed_point
from ann_dc.export.reference import reference_vector
from ann_dc.plotting import style

BITS = tuple(range(8, 25))
"""Word lengths in bits."""
LEVELS = tuple(round(2**power) for power in np.arange(1, 16.5, 0.5))
"""Numbers of conductance levels."""
UNITS = tuple(round(2**power) for power in np.arange(3, 12.5, 0.5))
"""Sizes of the largest capacitor in units."""
UNIT = 100e-15
"""Capacitance of a unit capacitor (F)."""
GOOD = 1e-3
"""Accepted control error, relative to the largest control."""
UNSEEN = 1e-16
"""Control error below which errors are drawn at this value."""
SETTLED = 1e-12
"""Tolerance of the relative KKT residual for onnxruntime."""
KINDS = {
    style.BLUE: ("numbers", ("weights", "csv", "onnx", "torch_program", "nir")),
    style.ORANGE: ("circuits", ("pack", "ltspice", "xyce", "kicad", "verilog_a")),
    style.GREEN: (
        "devices and integers",
        ("conductances", "capacitors", "analog_computer", "c99", "hdl"),
    ),
    style.PURPLE: ("publications", ("diagram", "schematic", "latex")),
}
"""Groups of formats by colour."""
WORD, LEVEL, CAPACITOR = "bits", "levels", "units"
AXES = {
    WORD: ("word length (bits, fixed point)", "one more"),
    LEVEL: ("number of conductance levels (crossbar)", "twice as many"),
    CAPACITOR: ("largest capacitor (units, switched capacitors)", "twice as many"),
}
"""Axis label of each resolution, and name of one octave."""
MIDDLE = 1e-8
"""Control error above which labels are placed to the left."""
Errors = dict[int, float]
"""Control error by resolution."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Result of an export; only `why_not` if the format does not support the network."""

    name: str
    bytes: int = 0
    seconds: float = np.nan
    error: float = np.nan
    checked: str = ""
    why_not: str = ""

    def __str__(self) -> str:
        """Return the row of the printed table."""
        if self.why_not:
            return f"{self.name:16} {self.why_not[:100]}"
        error = f"{self.error:8.1e}" if np.isfinite(self.error) else " " * 8
        return f"{self.name:16} {self.bytes:8} {self.seconds:6.2f} {error}  {self.checked}"


def main(
    out: Path | None = None,
    formats: Sequence[str] = tuple(FORMATS),
    bits: Sequence[int] = BITS,
    levels: Sequence[int] = LEVELS,
    units: Sequence[int] = UNITS,
) -> dict:
    """Round in three ways, export in every format; return errors, rows and the figure path."""
    problem = ann_dc.plants.car()
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    errors = rounded(network, bits, levels, units)
    for name, found in errors.items():
        print(f"{AXES[name][0]}: control error below {100 * GOOD:g} % from {sufficient(found)} on")
        print("  " + ", ".join(f"{value}: {error:.1e}" for value, error in found.items()))
    print(f"\n{'format':16} {'bytes':>8} {'s':>6} {'error':>8}  result of `ann-dc inspect`")
    with tempfile.TemporaryDirectory() as folder:
        rows = [exported(network, name, Path(folder)) for name in formats]
    print(*rows, sep="\n")
    figures = []
    if out is not None:
        figure = picture(problem, errors, rows)
        figures.append(plotting.save(figure, Path(out) / "26_export.png"))
    return {"errors": errors, "rows": rows, "figures": figures}


# ---- rounding --------------------------------------------------------------------------------


def rounded(
    network: ann_dc.Network, bits: Iterable[int], levels: Iterable[int], units: Iterable[int]
) -> dict[str, Errors]:
    """Compute control errors over word length, conductance levels and capacitor units."""
    vector = reference_vector(network, 1e-9)

    def in_words(count: int) -> float:
        return fixed_point(network, vector, bits=count, accuracy=1.0).error

    def in_levels(count: int) -> float | None:
        files = conductances_files(network, vector, levels=count)
        return json.loads(files["conductances.json"])["control_error"]

    def in_units(count: int) -> float | None:
        files = capacitors_files(network, vector, unit=UNIT, largest=count * UNIT)
        return json.loads(files["capacitors.json"])["control_error"]

    return {
        WORD: errors_of(bits, in_words),
        LEVEL: errors_of(levels, in_levels),
        CAPACITOR: errors_of(units, in_units),
    }


def errors_of(values: Iterable[int], error_of: Callable[[int], float | None]) -> Errors:
    """Compute the error for every value; nan if out of range or not settled."""
    found = {}
    for value in values:
        try:
            error = error_of(value)
        except ExportError:
            error = None
        found[value] = np.nan if error is None else error
    return found


def sufficient(found: Errors) -> int:
    """Return the smallest value from which all errors are below `GOOD`."""
    bad = [value for value, error in found.items() if not error < GOOD]
    return min((value for value in found if value > max(bad, default=0)), default=0)


# ---- exports ---------------------------------------------------------------------------------


def exported(network: ann_dc.Network, name: str, folder: Path) -> Row:
    """Export one format, inspect the files, and run them if a program in `RUN` supports it."""
    start = time.perf_counter()
    try:
        [done] = ann_dc.export_network(network, name, folder)
    except (ExportError, ExportPackageMissing) as error:
        return Row(name=name, why_not=str(error))
    seconds = time.perf_counter() - start
    [found] = ann_dc.inspect_export(done.folder)
    run = RUN.get(name)
    return Row(
        name=name,
        bytes=sum(file.stat().st_size for file in done.files),
        seconds=seconds,
        error=run[1](network, done.folder) if run else np.nan,
        checked=found.wrong or found.facts["checked"],
    )


def control_error(network: ann_dc.Network, x: np.ndarray) -> float:
    """Compute the control error of a state (n,), relative to the largest control."""
    rows = network.of_population("u")
    exact = network.user_units(ann_dc.equilibrium(network, x))[rows]
    return float(np.abs(network.user_units(x)[rows] - exact).max() / np.abs(exact).max())


def settled_state(network: ann_dc.Network) -> np.ndarray:
    """Run a network and return its equilibrium."""
    run = ann_dc.OdeBackend(verify=False).run(network)
    return ann_dc.equilibrium(network, run.trajectory.final)


def in_ann_dc(network: ann_dc.Network, folder: Path) -> float:
    """Return the control error of the loaded weight file."""
    return control_error(network, settled_state(ann_dc.load(folder / "network.safetensors")))


def of_conductances(network: ann_dc.Network, folder: Path) -> float:
    """Return the control error with weights from the conductances."""
    files = {file.name: file.read_bytes() for file in folder.iterdir()}
    weights = weights_of(files)
    wires = tuple(replace(c, weight=weights[c.name]) for c in network.cell.connections)
    cell = replace(network.cell, connections=wires)
    return control_error(network, settled_state(replace(network, cell=cell)))


def in_onnxruntime(network: ann_dc.Network, folder: Path) -> float:
    """Return the control error of the ONNX model in onnxruntime."""
    import onnxruntime

    vector = json.loads((folder / "reference_vector.json").read_bytes())
    session = onnxruntime.InferenceSession(folder / "settle.onnx")
    given = {
        "states": np.array(vector["start"])[..., None],
        "inputs": np.array([vector["inputs"][name] for name in network.cell.inputs])[..., None],
        "step": np.array(vector["step"]),
        "tolerance": np.array(SETTLED),
        "limit": np.array(3 * vector["steps"]),
    }
    states = np.asarray(session.run(["settled_states"], given)[0])
    return control_error(network, network.pack(states[..., 0]))


def in_torch(network: ann_dc.Network, folder: Path) -> float:
    """Return the control error of the torch program."""
    import torch

    vector = json.loads((folder / "reference_vector.json").read_bytes())
    program = torch.export.load(folder / "torch_program.pt2").module()
    x = torch.tensor(network.start_state)[None]
    inputs = torch.as_tensor(np.array([[vector["inputs"][name] for name in network.cell.inputs]]))
    step = torch.as_tensor(np.float64(vector["step"]))
    with torch.no_grad():
        for _ in range(3 * vector["steps"]):
            x = program(x, inputs, step)["x"]
    return control_error(network, x[0].numpy())


def in_ngspice(network: ann_dc.Network, folder: Path) -> float:
    """Return the control error of the netlist in ngspice."""
    subprocess.run(["ngspice", "-b", "deck.cir"], cwd=folder, check=True, capture_output=True)
    with open(folder / "controls.csv", encoding="utf-8") as file:
        rows = [(float(row["settled"]), float(row["expected"])) for row in csv.DictReader(file)]
    settled, expected = np.array(rows).T
    return float(np.abs(settled - expected).max() / np.abs(expected).max())


def in_c(network: ann_dc.Network, folder: Path) -> float:
    """Build and check the C code; return its control error."""
    subprocess.run(["make", "check"], cwd=folder, check=True, capture_output=True)
    return json.loads((folder / "fixed_point.json").read_bytes())["error"]


def of_capacitors(network: ann_dc.Network, folder: Path) -> float:
    """Return the control error with rounded capacitors."""
    return json.loads((folder / "capacitors.json").read_bytes())["control_error"]


RUN = {
    "weights": ("ann_dc", in_ann_dc),
    "onnx": ("onnxruntime", in_onnxruntime),
    "torch_program": ("torch", in_torch),
    "pack": ("ngspice", in_ngspice),
    "conductances": ("ann_dc", of_conductances),
    "capacitors": ("ann_dc, 256 units", of_capacitors),
    "c99": ("C compiler, 16 bits", in_c),
}
"""Program that evaluates each exported format, and function that computes its control error."""


# ---- figure ----------------------------------------------------------------------------------


def picture(problem: ann_dc.OptimalControlProblem, errors: dict[str, Errors], rows: list[Row]):
    """Draw errors over resolution above, formats below."""
    figure = plotting.new_figure(12.0, 9.2)
    above, below = figure.subfigures(2, 1, height_ratios=(4, 6))
    curves(above, errors)
    table(below, rows)
    plotting.headline(
        figure,
        f"{plotting.caption(problem)}, diagonal preconditioner: accuracy of exported networks\n"
        "Above: rounding. Below: size, export time and control error of every format",
    )
    return figure


def curves(figure, errors: dict[str, Errors]) -> None:
    """Draw a panel per way of rounding, over octaves, with a fitted line."""
    panels = figure.subplots(1, 3, sharey=True)
    for axes, (name, found) in zip(panels, errors.items()):
        label, octave = AXES[name]
        values, error = np.array([*found]), np.array([*found.values()])
        octaves = values if name == WORD else np.log2(values)
        held = np.isfinite(error)
        slope, first = np.polyfit(octaves[held], np.log10(error[held]), 1)
        axes.axhline(GOOD, color=style.INK, lw=0.8, ls=(0, (6, 4)))
        axes.plot(octaves, 10 ** (first + slope * octaves), ":", color=style.GREY, lw=1.2)
        axes.plot(octaves[held], error[held], "o", color=style.BLUE, ms=5, label="measured")
        axes.plot(octaves[~held], np.full(sum(~held), 1.0), "x", color=style.VERMILION,
                  ms=6, mew=1.8, label="out of range, or not settled")  # fmt: skip
        axes.set(xlabel=label, yscale="log", ylim=(1e-7, 3))
        axes.set_title(
            f"{100 * GOOD:g} % from {sufficient(found)} {name}; {octave}: error / {10**-slope:.1f}",
            fontsize=9,
        )
        if name != WORD:
            axes.xaxis.set_major_locator(MultipleLocator(2))
            axes.xaxis.set_major_formatter(lambda power, _: f"{2**power:.0f}")
        plotting.quiet(axes)
    panels[0].set_ylabel("control error\n(relative to the largest control)")
    panels[2].legend(frameon=False, fontsize=8, loc="lower left")


def table(figure, rows: list[Row]) -> None:
    """Draw a line per format: size, export time, control error, and omitted parts."""
    panels = figure.subplots(1, 4, sharey=True, width_ratios=(3, 3, 5, 8))
    size, seconds, error, words = panels
    for place, row in enumerate(rows):
        colour = next(c for c, (_, names) in KINDS.items() if row.name in names)
        size.barh(place, row.bytes / 1000, height=0.6, color=colour)
        seconds.plot(row.seconds, place, "o", color=colour, ms=6)
        where, _ = RUN.get(row.name, ("", None))
        at = max(row.error, UNSEEN)
        error.plot(at, place, "o", color=colour, ms=6)
        if np.isfinite(row.error):
            left = at > MIDDLE
            error.annotate(
                where, (at, place), (-7 if left else 7, 0), textcoords="offset points",
                ha="right" if left else "left", va="center", fontsize=8,
            )  # fmt: skip
        head, ink = ("not supported: ", style.VERMILION) if row.why_not else ("", style.INK)
        lost = FORMATS[row.name].loses.replace("`", "")
        words.text(0, place, textwrap.fill(head + lost, 88), va="center", fontsize=6.5, color=ink)
    size.set_yticks(range(len(rows)), [row.name for row in rows])
    size.set_ylim(len(rows) - 0.4, -0.6)
    size.set_xlabel("size of all\nfiles (kB)")
    seconds.set(xlabel="export\ntime (s)", xscale="log")
    error.set(
        xlabel="control error of the exported network\n(relative to the largest; no dot: not run)",
        xscale="log", xlim=(UNSEEN / 5, 1), xticks=10.0 ** np.arange(-15, 0, 3),
    )  # fmt: skip
    words.set_title("not preserved", fontsize=9, loc="left")
    words.set_axis_off()
    for axes in panels[:3]:
        plotting.quiet(axes)
    handles = [Patch(color=colour, label=kind) for colour, (kind, _) in KINDS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8)


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
