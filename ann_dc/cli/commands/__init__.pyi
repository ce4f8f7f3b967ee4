from .circuit import circuit as circuit
from .coordinate import coordinate as coordinate
from .paper import paper as paper
from .plants import plants as plants
from .show import show as show
from .solve import solve as solve
