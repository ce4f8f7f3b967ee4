from .area import area_of as area_of
from .files import PACKAGE as PACKAGE, installed as installed
