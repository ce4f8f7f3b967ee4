from .basin import End as End, basin as basin, ends as ends
from .constraints import tightened as tightened
from .forms import (
    FORMS as FORMS,
    FormEnd as FormEnd,
    end_of as end_of,
    settling_of_forms as settling_of_forms,
)
from .gains import (
    FACTORS as FACTORS,
    boundaries as boundaries,
    settling_against_gains as settling_against_gains,
)
from .hardware import (
    BOARD as BOARD,
    FIGURES as FIGURES,
    SPEC as SPEC,
    spot_check as spot_check,
    yield_curves as yield_curves,
)
from .horizon import (
    SIZES as SIZES,
    median_rho as median_rho,
    settling_against_horizon as settling_against_horizon,
)
from .realisations import REALISATIONS as REALISATIONS, realisations as realisations
from .steps import SHARES as SHARES, settling_against_steps as settling_against_steps
