from .capacitors import capacitors_files as capacitors_files
from .conductances import conductances_files as conductances_files, weights_of as weights_of
