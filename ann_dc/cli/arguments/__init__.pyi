from .backends import BACKENDS as BACKENDS
from .backends import FormOption as FormOption
from .backends import backend_of as backend_of
from .numbers import as_typed as as_typed
from .numbers import value_of as value_of
from .problem import (
    HorizonOption as HorizonOption,
)
from .problem import (
    ProblemArgument as ProblemArgument,
)
from .problem import (
    SetOption as SetOption,
)
from .problem import (
    StartStateOption as StartStateOption,
)
from .problem import (
    TargetOption as TargetOption,
)
from .problem import (
    defaults_of as defaults_of,
)
