from .determined import Determined as Determined, determined as determined
from .equations import (
    StageEquations as StageEquations,
    Stationarity as Stationarity,
    decompose as decompose,
)
from .form import (
    CORRECTED as CORRECTED,
    FORMS as FORMS,
    PRINTED as PRINTED,
    PRINTED_CONDITIONS as PRINTED_CONDITIONS,
    PRINTED_EXAMPLE as PRINTED_EXAMPLE,
    SWITCHES as SWITCHES,
    Form as Form,
    LowerForm as LowerForm,
    switch as switch,
)
from .idle import held as held, idle_controls as idle_controls
from .inequalities import InequalityRow as InequalityRow
from .latex import as_latex as as_latex
