from .cascade import Cascade as Cascade, Step as Step, cascade_of as cascade_of
from .curves import (
    Breakpoints as Breakpoints,
    Curve as Curve,
    Curves as Curves,
    FittedChords as FittedChords,
    FittedPolynomial as FittedPolynomial,
    FittedQuotient as FittedQuotient,
    Polynomial as Polynomial,
)
from .stretch import GRID as GRID, Stretch as Stretch
