from .circuit_study import (
    NEAR as NEAR,
)
from .circuit_study import (
    CircuitStudy as CircuitStudy,
)
from .circuit_study import (
    study_circuit as study_circuit,
)
from .error_budget import (
    Item as Item,
)
from .error_budget import (
    budget as budget,
)
from .error_budget import (
    sensitivity as sensitivity,
)
from .error_budget import (
    total_error as total_error,
)
from .ladder import (
    Ladder as Ladder,
)
from .ladder import (
    Measured as Measured,
)
from .ladder import (
    climb as climb,
)
from .ladder import (
    cpu_rungs as cpu_rungs,
)
from .ladder import (
    ode_rung as ode_rung,
)
from .ladder import (
    quick as quick,
)
from .ladder import (
    recurrent_rung as recurrent_rung,
)
from .monte_carlo import (
    measured_errors as measured_errors,
)
from .monte_carlo import (
    predicted_errors as predicted_errors,
)
from .monte_carlo import (
    sample_decks as sample_decks,
)
from .noise_run import (
    run_with_noise as run_with_noise,
)
from .noise_run import (
    settled_noise as settled_noise,
)
from .noise_run import (
    started_at as started_at,
)
from .prediction import Reason as Reason
from .prediction import predict as predict
from .prediction import smallest_margin as smallest_margin
from .rung import Group as Group
from .rung import Rung as Rung
from .rung import rungs as rungs
from .specimen import Specimen as Specimen
