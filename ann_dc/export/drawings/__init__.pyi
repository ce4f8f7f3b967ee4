from .diagram import diagram_files as diagram_files
from .equations import latex_files as latex_files
