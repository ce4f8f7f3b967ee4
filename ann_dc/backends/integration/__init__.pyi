from .integrator import (
    DOP853_TABLEAU as DOP853_TABLEAU,
    Course as Course,
    Ends as Ends,
    Log as Log,
    Tableau as Tableau,
    advance as advance,
    begin as begin,
)
from .steppers import (
    CompiledStepper as CompiledStepper,
    RightHandSide as RightHandSide,
    SciPyStepper as SciPyStepper,
    Stepper as Stepper,
)
