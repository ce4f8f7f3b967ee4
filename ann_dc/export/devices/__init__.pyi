from .analog_computer import (
    analog_computer_check as analog_computer_check,
    analog_computer_files as analog_computer_files,
)
from .capacitors import (
    capacitors_check as capacitors_check,
    capacitors_files as capacitors_files,
    units_of as units_of,
)
from .conductances import (
    conductances_check as conductances_check,
    conductances_files as conductances_files,
    weights_of as weights_of,
)
