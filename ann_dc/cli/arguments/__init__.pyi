from .backends import (
    BACKENDS as BACKENDS,
    RunOptions as RunOptions,
    StartOptions as StartOptions,
    backend_of as backend_of,
    form_of as form_of,
    objective_of as objective_of,
    start_of as start_of,
)
from .building import fitted_to_build as fitted_to_build, network_to_build as network_to_build
from .kinds import (
    KINDS as KINDS,
    KindsOption as KindsOption,
    MetricOption as MetricOption,
    kinds_of as kinds_of,
    metric_of as metric_of,
)
from .levels import LevelOptions as LevelOptions, level_of as level_of, series_of as series_of
from .lookup import named as named
from .numbers import (
    as_typed as as_typed,
    number_of as number_of,
    settings_of as settings_of,
    value_of as value_of,
)
from .output import JsonOption as JsonOption, QuietOption as QuietOption
from .problem import (
    ProblemOptions as ProblemOptions,
    arithmetic_of as arithmetic_of,
    defaults_of as defaults_of,
    plant_of as plant_of,
)
from .records import unfolded as unfolded
