from .area import Area as Area, area_of as area_of
from .devices import Device as Device, devices_in as devices_in
from .excerpt import excerpt as excerpt
from .files import (
    AGAIN as AGAIN,
    INSTALL as INSTALL,
    PACKAGE as PACKAGE,
    PdkFiles as PdkFiles,
    installed as installed,
)
from .place import INSTEAD as INSTEAD, Place as Place, place_of as place_of
