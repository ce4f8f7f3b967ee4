from .kicad import kicad_check as kicad_check, kicad_files as kicad_files
from .pack import pack_check as pack_check, pack_files as pack_files
