from . import cell as cell
from .diagram import diagram_check as diagram_check, diagram_files as diagram_files
