from .iterations import (
    figure_6 as figure_6,
    figure_of_definitions as figure_of_definitions,
    figure_of_following as figure_of_following,
)
from .overview import overview as overview
from .paths import (
    figure_4 as figure_4,
    figure_5 as figure_5,
    free_controls as free_controls,
    free_paths as free_paths,
    plane as plane,
)
from .schemes import figure_1 as figure_1, figure_2 as figure_2, figure_3 as figure_3
