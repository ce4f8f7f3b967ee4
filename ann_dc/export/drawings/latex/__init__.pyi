from .document import document_of as document_of
from .structure import check_structure as check_structure
