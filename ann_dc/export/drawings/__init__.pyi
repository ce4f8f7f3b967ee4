from .diagram import diagram_files as diagram_files
from .latex_document import document_of as document_of
from .latex_structure import check_structure as check_structure
