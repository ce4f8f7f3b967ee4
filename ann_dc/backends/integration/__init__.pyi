from .cells import Cells as Cells
from .drawing import (
    CompiledAgain as CompiledAgain,
    Pieces as Pieces,
    SolvedAgain as SolvedAgain,
)
from .exits import last_exit as last_exit, located_exit as located_exit
from .integrator import (
    Course as Course,
    Ends as Ends,
    Log as Log,
    advance as advance,
    draw as draw,
)
from .steppers import (
    CompiledStepper as CompiledStepper,
    RightHandSide as RightHandSide,
    SciPyStepper as SciPyStepper,
    Stepper as Stepper,
)
from .systems import (
    Integrand as Integrand,
    generated as generated,
    interpreted as interpreted,
)
from .tableaus import (
    DOP853_TABLEAU as DOP853_TABLEAU,
    TSIT5_TABLEAU as TSIT5_TABLEAU,
    Rows as Rows,
    Tableau as Tableau,
)
