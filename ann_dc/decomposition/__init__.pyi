from .equations import StageEquations as StageEquations, decompose as decompose
from .form import (
    CORRECTED as CORRECTED,
    PRINTED as PRINTED,
    PRINTED_CONDITIONS as PRINTED_CONDITIONS,
    PRINTED_EXAMPLE as PRINTED_EXAMPLE,
    SWITCHES as SWITCHES,
    Form as Form,
    switch as switch,
)
from .idle import held as held
