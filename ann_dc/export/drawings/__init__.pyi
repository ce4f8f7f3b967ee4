from . import cell as cell, latex as latex
from .chain_diagram import chain_page as chain_page
from .diagram import diagram_check as diagram_check, diagram_files as diagram_files
from .equations import latex_check as latex_check, latex_files as latex_files
from .schematic import schematic_check as schematic_check, schematic_files as schematic_files
from .sheets import circuit_sheets as circuit_sheets
