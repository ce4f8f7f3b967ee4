from .dialects import (
    dialect_check as dialect_check,
    ltspice_files as ltspice_files,
    xyce_files as xyce_files,
)
from .kicad import kicad_check as kicad_check, kicad_files as kicad_files
from .pack import pack_check as pack_check, pack_files as pack_files
from .verilog_a import verilog_a_check as verilog_a_check, verilog_a_files as verilog_a_files
