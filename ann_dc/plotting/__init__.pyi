from . import style as style, worlds as worlds
from .circuits import circuit as circuit, comparison as comparison
from .convergence import convergence as convergence
from .designs import diagnosis as diagnosis, family as family, front as front
from .solutions import (
    controls as controls,
    save_all as save_all,
    settling as settling,
    spectrum as spectrum,
    trajectory as trajectory,
)
from .style import (
    caption as caption,
    headline as headline,
    new_figure as new_figure,
    quiet as quiet,
    save as save,
    title as title,
    with_unit as with_unit,
)
