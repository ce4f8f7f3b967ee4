from .equations import (
    StageEquations as StageEquations,
)
from .equations import (
    Stationarity as Stationarity,
)
from .equations import (
    decompose as decompose,
)
from .form import (
    CORRECTED as CORRECTED,
)
from .form import (
    PRINTED as PRINTED,
)
from .form import (
    SWITCHES as SWITCHES,
)
from .form import (
    Form as Form,
)
from .form import (
    switch as switch,
)
from .latex import as_latex as as_latex
