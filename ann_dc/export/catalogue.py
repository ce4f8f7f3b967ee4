"""Every format, by its name, in the order in which the table of them is read."""

from __future__ import annotations

from ann_dc.export.devices.capacitors import capacitors_check, capacitors_files
from ann_dc.export.devices.conductances import conductances_check, conductances_files
from ann_dc.export.drawings.diagram import diagram_check, diagram_files
from ann_dc.export.formats import Format
from ann_dc.export.netlists.kicad import kicad_check, kicad_files
from ann_dc.export.netlists.pack import pack_check, pack_files

FORMATS: dict[str, Format] = {
    "pack": Format(
        title="decks, library, bill, scaling and expected waveforms for ngspice",
        write=pack_files,
        check=pack_check,
        carries="the circuit of a level, part by part",
        loses="names of problems beyond the scaling sheet",
    ),
    "kicad": Format(
        title="netlist for KiCad's board editor",
        write=kicad_files,
        check=kicad_check,
        carries="parts with values and footprints, and what they are connected to",
        loses="behaviour: no models",
    ),
    "conductances": Format(
        title="pairs of conductances for crossbars",
        write=conductances_files,
        check=conductances_check,
        carries="every weight, with the exact inverse",
        loses="blocks and neurons: they are not on the crossbar",
    ),
    "capacitors": Format(
        title="ratios of unit capacitors for switched-capacitor chips",
        write=capacitors_files,
        check=capacitors_check,
        carries="every weight as whole units",
        loses="what rounding to whole units takes away, which is told",
    ),
    "diagram": Format(
        title="the cell and the row as a diagram, SVG and PDF",
        write=diagram_files,
        check=diagram_check,
        carries="neurons, blocks, weights, what goes to the neighbours",
        loses="numbers beyond the digits shown",
    ),
}
"""Names on the command line."""
