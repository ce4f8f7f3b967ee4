"""Catalogue of export formats by name, in the order of the printed table.

Inspection of exported files and folders: content and integrity.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ann_dc.errors import AnnDcError, ExportPackageMissing, FileFormatError
from ann_dc.export.behaviour import behaviour
from ann_dc.export.devices.analog_computer import analog_computer_check, analog_computer_files
from ann_dc.export.devices.capacitors import capacitors_check, capacitors_files
from ann_dc.export.devices.conductances import conductances_check, conductances_files
from ann_dc.export.drawings.diagram import diagram_files
from ann_dc.export.drawings.equations import latex_files
from ann_dc.export.drawings.schematic import schematic_files
from ann_dc.export.fixed_point.c99 import c99_check, c99_files
from ann_dc.export.fixed_point.hdl import hdl_check, hdl_files
from ann_dc.export.formats import Files, Format
from ann_dc.export.index import INDEX, Index, check_index, read_files, read_index
from ann_dc.export.netlists.dialects import ltspice_files, xyce_files
from ann_dc.export.netlists.kicad import kicad_files
from ann_dc.export.netlists.pack import pack_files, stated_in_pack
from ann_dc.export.netlists.verilog_a import verilog_a_files
from ann_dc.export.onnx.check import onnx_check
from ann_dc.export.onnx.files import onnx_files
from ann_dc.export.reference.contents import stated
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.export.runtimes.nir_graph import nir_check, nir_files
from ann_dc.export.runtimes.torch_program import torch_program_check, torch_program_files
from ann_dc.export.weight_files import csv_check, csv_files, weights_check, weights_files
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.si_prefixes import counted
from ann_dc.validation import checked
from ann_dc.weights.hashes import content_hash, wiring_hash
from ann_dc.weights.network_file import load

DECK = "deck.cir parts.csv scaling.csv expected_controls.csv SHA256SUMS"
"""Files of all exported decks."""

FORMATS: dict[str, Format] = {
    "weights": Format(
        title="arrays with names and units, and a manifest: safetensors or NPZ",
        write=weights_files,
        contents=f"{VECTOR} manifest.json network.safetensors | {VECTOR} manifest.json network.npz",
        run=weights_check,
        carries="everything: `load` gives an equal network, to the last bit",
        loses="nothing",
    ),
    "csv": Format(
        title="one matrix of all weights of the array, in readable form",
        write=csv_files,
        contents=f"{VECTOR} weights.csv tensors.csv manifest.json",
        run=csv_check,
        carries="every synapse with the names of its nodes, every bias",
        loses="time constants, limits, preconditioner",
    ),
    "onnx": Format(
        title="a step, and the loop to settling, for machine-learning runtimes",
        write=onnx_files,
        contents=f"{VECTOR} step.onnx settle.onnx",
        run=onnx_check,
        carries="dynamics, preconditioner, limits, domains, residual; any batch",
        loses="adaptive steps, acceleration, detection of stalled runs",
    ),
    "torch_program": Format(
        title="a step as a program of torch.export",
        write=torch_program_files,
        contents=f"{VECTOR} torch_program.pt2 torch_program.json",
        run=torch_program_check,
        executes=True,
        carries="dynamics, preconditioner, limits; any batch",
        loses="the loop to settling",
    ),
    "nir": Format(
        title="a graph of the neuromorphic intermediate representation",
        write=nir_files,
        contents=f"{VECTOR} network.nir nir.json",
        run=nir_check,
        carries="linear networks: integrators and affine maps",
        loses="products, functions and limits (rejected by name)",
    ),
    "pack": Format(
        title="decks, library, bill, scaling and expected waveforms: run ngspice -b",
        write=pack_files,
        contents=f"pack.zip | {VECTOR} {DECK} bill.csv expected_waveforms.csv library/*",
        run=stated_in_pack,
        carries="the circuit of a level, part by part",
        loses="the problem (values are in volts and seconds)",
    ),
    "ltspice": Format(
        title="netlist in LTspice's dialect (not tested in LTspice)",
        write=ltspice_files,
        contents=f"{VECTOR} {DECK}",
        run=stated,
        carries="the circuit of a level",
        loses="tolerances and bill",
    ),
    "xyce": Format(
        title="netlist in Xyce's dialect (not tested in Xyce)",
        write=xyce_files,
        contents=f"{VECTOR} {DECK}",
        run=stated,
        carries="the circuit of a level",
        loses="tolerances and bill",
    ),
    "kicad": Format(
        title="netlist for KiCad's board editor",
        write=kicad_files,
        contents=f"{VECTOR} circuit.net parts.csv",
        run=stated,
        carries="components with values and footprints, and their nets",
        loses="behaviour (KiCad parts have no models)",
    ),
    "verilog_a": Format(
        title="modules from the integrator to the whole network (not tested in a simulator)",
        write=verilog_a_files,
        contents=f"{VECTOR} network.va scaling.csv expected_controls.csv SHA256SUMS",
        run=stated,
        carries="behaviour in volts and seconds",
        loses="parts and their non-idealities",
    ),
    "conductances": Format(
        title="pairs of conductances for crossbars",
        write=conductances_files,
        contents=f"{VECTOR} conductances.csv conductances.json network.npz",
        run=conductances_check,
        carries="every weight, with its exact inverse",
        loses="blocks and neurons (not on the crossbar); digits beyond the levels",
    ),
    "capacitors": Format(
        title="whole unit capacitors for switched-capacitor chips",
        write=capacitors_files,
        contents=f"{VECTOR} capacitors.csv capacitors.json network.npz",
        run=capacitors_check,
        carries="every weight and time constant as a ratio",
        loses="digits beyond whole units (the rounding is reported)",
    ),
    "analog_computer": Format(
        title="integrators, multipliers and coefficients of REDAC-like computers",
        write=analog_computer_files,
        contents=f"{VECTOR} analog_computer.json",
        run=analog_computer_check,
        carries="the whole flow, scaled to +-1 machine unit",
        loses="routing to a machine's clusters; limits of coupled neurons (rejected by name)",
    ),
    "c99": Format(
        title="C99 without floating point, with a self-test",
        write=c99_files,
        contents="*",
        run=c99_check,
        carries="the recurrence in integers, equal to the golden model bit for bit",
        loses="digits beyond the word length; inputs out of range saturate (reported by a "
        "status); limits of coupled neurons (rejected by name)",
    ),
    "hdl": Format(
        title="SystemVerilog with one multiplier, and a testbench",
        write=hdl_files,
        contents="*",
        run=hdl_check,
        carries="the recurrence in integers, equal to the golden model bit for bit",
        loses="digits beyond the word length; inputs out of range saturate (reported by a "
        "status); limits of coupled neurons (rejected by name)",
    ),
    "diagram": Format(
        title="the cell or the array as a diagram, SVG and PDF",
        write=diagram_files,
        contents=f"{VECTOR} cell.svg cell.pdf | {VECTOR} chain.svg chain.pdf",
        carries="neurons, blocks, weights, connections to the neighbours",
        loses="digits beyond those shown",
    ),
    "schematic": Format(
        title="one part of every kind with its values, SVG and PDF",
        write=schematic_files,
        contents=f"{VECTOR} schematic_*.svg schematic_*.pdf",
        carries="one of each kind",
        loses="all other parts (complete in `pack`)",
    ),
    "latex": Format(
        title="the equations of the cell, and tables of its numbers",
        write=latex_files,
        contents=f"{VECTOR} equations.tex",
        carries="every neuron, weight and input",
        loses="digits beyond those shown",
    ),
}
"""Export formats by their names on the command line."""


NETWORKS = (".npz", ".safetensors")
"""File name suffixes of network files."""
SHOWN = 16
"""Number of displayed digits of a hash."""


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Result of the inspection of one file or folder.

    ``kind`` is that of its content, ``facts`` are its properties, and ``wrong`` describes the first
    error, if any.
    """

    place: Path
    kind: str
    facts: dict[str, str]
    wrong: str = ""

    @property
    def good(self) -> bool:
        """True if the content is unmodified and behaves as recorded."""
        return not self.wrong


@checked
def inspect_export(
    path: str | os.PathLike[str], *, progress: Progress = silent
) -> list[Inspection]:
    """Inspect a weight file, the folder of an export, or a folder with exports.

    Hashes are checked, and the behaviour of a file is compared with its test vector if the file can
    be run. A network is run until it settles; if it does not and is not an optimiser, its unstable
    equilibrium is reported instead. Code in a file is never executed: netlists and
    programs are checked by their hashes.

    Parameters
    ----------
    path : path-like
        File or folder to inspect.
    progress : Progress
        Receiver of progress messages. Silent by default.

    Returns
    -------
    list of Inspection
        One entry per export.

    Raises
    ------
    FileFormatError
        If the path contains neither a weight file nor an export.

    Examples
    --------
    >>> import tempfile, ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ann_dc.save(network, f"{folder}/network.npz")
    ...     [found] = inspect_export(f"{folder}/network.npz")
    >>> found.good, found.facts["neurons"]
    (True, '21 in 3 cells')
    """
    place = Path(path)
    if place.is_file() and place.suffix in NETWORKS:
        progress(f"reading {place}")
        return [_of_network(place)]
    folders = [place] if (place / INDEX).is_file() else []
    folders += sorted(index.parent for index in place.glob(f"*/{INDEX}")) if place.is_dir() else []
    if not folders:
        raise FileFormatError(
            f"{str(place)!r}: no weight file ({', '.join(NETWORKS)}) and no folder that ann-dc "
            "export wrote; use one of these"
        )
    found = []
    for folder in folders:
        progress(f"checking {folder}")
        found.append(_of_folder(folder))
    return found


def short(digest: str) -> str:
    """Return the first digits of a hash, sufficient for comparison by readers."""
    return digest[:SHOWN]


def _of_folder(folder: Path) -> Inspection:
    kind, facts = "export", {}
    try:
        index = read_index(folder)
        kind = index.to
        facts = {
            "network": index.title,
            "wiring": short(index.wiring),
            "content": short(index.content),
            "settings": ", ".join(f"{k}={v}" for k, v in index.settings.items()) or "default",
            "written by": f"ann_dc {index.version}",
        }
        if kind not in FORMATS:
            raise FileFormatError(f"format {kind!r:.40} is none that this ann_dc knows")
        files = read_files(folder, index)
        check_index(folder, index)
        _check_network(index, files)
        facts["files"] = ", ".join(f"{name} ({len(c):,} bytes)" for name, c in files.items())
        facts["checked"] = FORMATS[kind].inspect(files)
    except ExportPackageMissing as error:
        facts["checked"] = f"hashes alone; not run: {error}"
    except AnnDcError as error:
        return Inspection(place=folder, kind=kind, facts=facts, wrong=str(error))
    return Inspection(place=folder, kind=kind, facts=facts)


def _check_network(index: Index, files: Files) -> None:
    """Check that the index and the test vector belong to the same network."""
    if VECTOR not in files:  # found with the names of the files
        return
    vector = ReferenceVector.from_json(files[VECTOR])
    if (index.wiring, index.content) != (vector.wiring, vector.content):
        raise FileFormatError(
            f"{INDEX}: belongs to another network than {VECTOR}; export the network again"
        )


def _of_network(file: Path) -> Inspection:
    try:
        network = load(file)
    except FileFormatError as error:
        return Inspection(place=file, kind="network", facts={}, wrong=str(error))
    facts = _of_wiring(network)
    if network.waveforms:
        facts["inputs over time"] = f"{', '.join(network.waveforms)}; below: their values at time 0"
    found, wrong = behaviour(network, file)
    facts |= found
    return Inspection(place=file, kind="network", facts=facts, wrong=wrong)


def _of_wiring(network: Network) -> dict[str, str]:
    cell = network.cell
    return {
        "network": network.title,
        "neurons": f"{network.size} in {counted(network.stages, 'cells')}",
        "cell": f"{counted(len(cell.neurons), 'neurons')}, {counted(len(cell.blocks), 'blocks')}, "
        f"{counted(len(cell.connections), 'connections')}",
        "inputs": ", ".join(cell.inputs) or "none",
        "preconditioner": network.preconditioner.kind.value,
        "wiring": short(wiring_hash(network)),
        "content": short(content_hash(network)),
    }
