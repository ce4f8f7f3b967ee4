from .around import (
    Around as Around,
    Piece as Piece,
    around as around,
    driven as driven,
    obstacles as obstacles,
    with_discs as with_discs,
)
from .example import (
    OFF as OFF,
    PaperRun as PaperRun,
    corrected_runs as corrected_runs,
    demonstrations as demonstrations,
)
from .paths import Path as Path, path_of as path_of, rolled_out as rolled_out, run_away as run_away
from .replans import (
    CASES as CASES,
    Case as Case,
    Iterations as Iterations,
    Plans as Plans,
    iterations as iterations,
    one_gain as one_gain,
    replanned as replanned,
    to_the_letter as to_the_letter,
)
