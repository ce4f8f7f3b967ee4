from .numbers import (
    detuned as detuned,
    drawn_numbers as drawn_numbers,
    gain_error as gain_error,
    leak as leak,
    mismatch as mismatch,
    offset as offset,
    quantised as quantised,
)
from .parts import (
    extra_pole as extra_pole,
    noise as noise,
    saturation as saturation,
    slew as slew,
)
