from .expressions import value_of as value_of
from .process import find_ngspice as find_ngspice, version as version
from .raw import Raw as Raw, read_raw as read_raw
from .runner import Ngspice as Ngspice
