"""Catalogue of export formats by name, in the order of the printed table."""

from __future__ import annotations

from ann_dc.export.devices.analog_computer import analog_computer_check, analog_computer_files
from ann_dc.export.devices.capacitors import capacitors_check, capacitors_files
from ann_dc.export.devices.conductances import conductances_check, conductances_files
from ann_dc.export.drawings.diagram import diagram_check, diagram_files
from ann_dc.export.drawings.equations import latex_check, latex_files
from ann_dc.export.drawings.schematic import schematic_check, schematic_files
from ann_dc.export.fixed_point.c99 import c99_check, c99_files
from ann_dc.export.fixed_point.hdl import hdl_check, hdl_files
from ann_dc.export.formats import Format
from ann_dc.export.netlists.dialects import dialect_check, ltspice_files, xyce_files
from ann_dc.export.netlists.kicad import kicad_check, kicad_files
from ann_dc.export.netlists.pack import pack_check, pack_files
from ann_dc.export.netlists.verilog_a import verilog_a_check, verilog_a_files
from ann_dc.export.onnx.check import onnx_check
from ann_dc.export.onnx.files import onnx_files
from ann_dc.export.plain_tables import csv_check, csv_files
from ann_dc.export.runtimes.nir_graph import nir_check, nir_files
from ann_dc.export.runtimes.torch_program import torch_program_check, torch_program_files
from ann_dc.export.weight_files import weights_check, weights_files

FORMATS: dict[str, Format] = {
    "weights": Format(
        title="arrays with names and units, and a manifest: safetensors or NPZ",
        write=weights_files,
        check=weights_check,
        carries="everything: `load` gives an equal network, to the last bit",
        loses="nothing",
    ),
    "csv": Format(
        title="one matrix of all weights of the row, for people who want to look",
        write=csv_files,
        check=csv_check,
        carries="every synapse with the names of its ends, every bias",
        loses="time constants, limits, preconditioner",
    ),
    "onnx": Format(
        title="a step, and the loop to settling, for machine-learning runtimes",
        write=onnx_files,
        check=onnx_check,
        carries="dynamics, preconditioner, rails, domains, residual; any batch",
        loses="adaptive steps, acceleration, the rule that ends what stalls",
    ),
    "torch_program": Format(
        title="a step as a program of torch.export",
        write=torch_program_files,
        check=torch_program_check,
        carries="dynamics, preconditioner, rails; any batch",
        loses="the loop to settling",
    ),
    "nir": Format(
        title="a graph of the neuromorphic intermediate representation",
        write=nir_files,
        check=nir_check,
        carries="linear networks: integrators and affine maps",
        loses="products, functions and rails are refused by name",
    ),
    "pack": Format(
        title="decks, library, bill, scaling and expected waveforms: run ngspice -b",
        write=pack_files,
        check=pack_check,
        carries="the circuit of a level, part by part",
        loses="the problem: it is in volts and seconds",
    ),
    "ltspice": Format(
        title="the same deck in LTspice's dialect, which was not run in LTspice",
        write=ltspice_files,
        check=dialect_check,
        carries="the circuit of a level",
        loses="tolerances and bill",
    ),
    "xyce": Format(
        title="the same deck in Xyce's dialect, which was not run in Xyce",
        write=xyce_files,
        check=dialect_check,
        carries="the circuit of a level",
        loses="tolerances and bill",
    ),
    "kicad": Format(
        title="netlist for KiCad's board editor",
        write=kicad_files,
        check=kicad_check,
        carries="components with values and footprints, and their nets",
        loses="behaviour: there are no models",
    ),
    "verilog_a": Format(
        title="modules from the integrator to the whole network, not run by a simulator",
        write=verilog_a_files,
        check=verilog_a_check,
        carries="behaviour in volts and seconds",
        loses="parts and their defects",
    ),
    "conductances": Format(
        title="pairs of conductances for crossbars",
        write=conductances_files,
        check=conductances_check,
        carries="every weight, with its exact inverse",
        loses="blocks and neurons, which are not on the crossbar; digits beyond the levels",
    ),
    "capacitors": Format(
        title="whole unit capacitors for switched-capacitor chips",
        write=capacitors_files,
        check=capacitors_check,
        carries="every weight and time constant as a ratio",
        loses="what rounding to whole units takes away, and tells",
    ),
    "analog_computer": Format(
        title="integrators, multipliers and coefficients of REDAC-like computers",
        write=analog_computer_files,
        check=analog_computer_check,
        carries="the whole flow, scaled to +-1 machine unit",
        loses="routing to a machine's clusters; rails of coupled neurons are refused by name",
    ),
    "c99": Format(
        title="C99 without floating point, which tests itself",
        write=c99_files,
        check=c99_check,
        carries="the recurrence in integers, bit for bit that of its golden model",
        loses="digits beyond the word; inputs out of range saturate, which a status tells; rails "
        "of coupled neurons are refused by name",
    ),
    "hdl": Format(
        title="SystemVerilog with one multiplier, and a testbench",
        write=hdl_files,
        check=hdl_check,
        carries="the same integers",
        loses="the same",
    ),
    "diagram": Format(
        title="the cell or the row as a diagram, SVG and PDF",
        write=diagram_files,
        check=diagram_check,
        carries="neurons, blocks, weights, what goes to the neighbours",
        loses="digits beyond those shown",
    ),
    "schematic": Format(
        title="every kind of part with its values, SVG and PDF",
        write=schematic_files,
        check=schematic_check,
        carries="one of each kind",
        loses="all parts but one of each kind: `pack` has them all",
    ),
    "latex": Format(
        title="the equations of the cell, and tables of its numbers",
        write=latex_files,
        check=latex_check,
        carries="every neuron, weight and input",
        loses="digits beyond those shown",
    ),
}
"""Export formats by their names on the command line."""
