from .circuit import circuit as circuit
from .controls import controls as controls
from .diagnosis import diagnosis as diagnosis
from .family import family as family, front as front
from .level_comparison import ladder as ladder
from .saving import (
    save as save,
    save_all as save_all,
)
from .settling import settling as settling
from .spectrum import spectrum as spectrum
from .style import (
    BLUE as BLUE,
    FASTEST as FASTEST,
    GREEN as GREEN,
    GREY as GREY,
    INK as INK,
    ORANGE as ORANGE,
    PURPLE as PURPLE,
    SKY as SKY,
    UNSCALED as UNSCALED,
    VERMILION as VERMILION,
    caption as caption,
    headline as headline,
    new_figure as new_figure,
    quiet as quiet,
    time_label as time_label,
    title as title,
    with_unit as with_unit,
)
from .trajectory import trajectory as trajectory
