from .backends import BACKENDS as BACKENDS, FormOption as FormOption, backend_of as backend_of
from .numbers import as_typed as as_typed, value_of as value_of
from .problem import (
    HorizonOption as HorizonOption,
    ProblemArgument as ProblemArgument,
    SetOption as SetOption,
    StartStateOption as StartStateOption,
    TargetOption as TargetOption,
    defaults_of as defaults_of,
)
