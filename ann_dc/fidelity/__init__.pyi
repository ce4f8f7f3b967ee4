from .circuit_instance import CircuitInstance as CircuitInstance
from .circuit_study import (
    measured_errors as measured_errors,
    predicted_errors as predicted_errors,
    study_circuit as study_circuit,
)
from .error_budget import (
    Item as Item,
    budget as budget,
    sensitivity as sensitivity,
    total_error as total_error,
)
from .fitting import fitting_intervals as fitting_intervals, smallest_margin as smallest_margin
from .level_comparison import (
    compare_levels as compare_levels,
    compared_levels as compared_levels,
    quick as quick,
)
from .loop_gains import LoopGain as LoopGain, loop_gains as loop_gains
from .prediction import predict as predict, prediction_of as prediction_of
