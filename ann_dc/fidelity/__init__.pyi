from .circuit_study import (
    NEAR as NEAR,
    CircuitStudy as CircuitStudy,
    study_circuit as study_circuit,
)
from .error_budget import (
    Item as Item,
    budget as budget,
    sensitivity as sensitivity,
    total_error as total_error,
)
from .fitting import (
    fitted as fitted,
    fitting_intervals as fitting_intervals,
    fitting_margin as fitting_margin,
    smallest_margin as smallest_margin,
)
from .ladder import (
    Ladder as Ladder,
    Measured as Measured,
    climb as climb,
    ode_rung as ode_rung,
    quick as quick,
    recurrent_rung as recurrent_rung,
)
from .loops import LoopGain as LoopGain, loop_gains as loop_gains
from .metric_demand import MetricDemand as MetricDemand, metric_demand as metric_demand
from .monte_carlo import (
    measured_errors as measured_errors,
    measured_runs as measured_runs,
    predicted_errors as predicted_errors,
    sample_decks as sample_decks,
    settled_error as settled_error,
    specimens as specimens,
)
from .noise_run import (
    control_noise as control_noise,
    run_with_noise as run_with_noise,
    settled_noise as settled_noise,
    started_at as started_at,
)
from .prediction import (
    Prediction as Prediction,
    Reason as Reason,
    Unpredicted as Unpredicted,
    predict as predict,
    prediction_of as prediction_of,
)
from .rung import Group as Group, Rung as Rung, rungs as rungs
from .specimen import Specimen as Specimen
