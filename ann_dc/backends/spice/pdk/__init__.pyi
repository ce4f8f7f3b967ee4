from .area import Area as Area, area_of as area_of
from .devices import Device as Device, devices_in as devices_in
from .excerpt import excerpt as excerpt
from .files import INSTALL as INSTALL, PdkFiles as PdkFiles, installed as installed
from .place import INSTEAD as INSTEAD, Place as Place, place_of as place_of
