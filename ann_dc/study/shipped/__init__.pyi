from .forms import End as End, end_of as end_of, settling_of_forms as settling_of_forms
from .gains import (
    boundaries as boundaries,
    gain_names as gain_names,
    settling_against_gains as settling_against_gains,
)
from .horizon import (
    Exponent as Exponent,
    exponent_of as exponent_of,
    settling_against_horizon as settling_against_horizon,
)
from .steps import (
    Steps as Steps,
    settling_against_steps as settling_against_steps,
)
