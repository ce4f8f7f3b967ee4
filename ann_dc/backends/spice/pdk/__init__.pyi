from .area import area_of as area_of
from .excerpt import excerpt as excerpt
from .files import PACKAGE as PACKAGE, installed as installed
