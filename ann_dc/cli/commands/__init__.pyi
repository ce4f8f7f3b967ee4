from .app import main as main
from .circuit import circuit as circuit
from .coordinate import coordinate as coordinate
from .design import design as design
from .exports import export as export, inspect as inspect
from .ladder import ladder as ladder
from .navigate import navigate as navigate
from .paper import paper as paper
from .plants import plants as plants
from .show import show as show
from .solve import solve as solve
from .studies import report as report, study as study
