from .forms import (
    FORMS as FORMS,
    End as End,
    end_of as end_of,
    settling_of_forms as settling_of_forms,
)
from .gains import (
    FACTORS as FACTORS,
    boundaries as boundaries,
    gain_names as gain_names,
    settling_against_gains as settling_against_gains,
)
from .horizon import (
    SIZES as SIZES,
    Exponent as Exponent,
    exponent_of as exponent_of,
    median_rho as median_rho,
    settling_against_horizon as settling_against_horizon,
)
from .steps import (
    SHARES as SHARES,
    Steps as Steps,
    settling_against_steps as settling_against_steps,
)
