from .process import find_ngspice as find_ngspice
from .process import version as version
from .raw import Raw as Raw
from .raw import read_raw as read_raw
from .runner import Ngspice as Ngspice
