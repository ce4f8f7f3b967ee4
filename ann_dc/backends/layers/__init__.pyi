from .cell_layer import CellLayer as CellLayer
from .recurrent_layer import RecurrentLayer as RecurrentLayer
