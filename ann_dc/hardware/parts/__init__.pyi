from . import levels as levels
from . import presets as presets
from .curves import (
    Breakpoints as Breakpoints,
)
from .curves import (
    Curve as Curve,
)
from .curves import (
    FittedChords as FittedChords,
)
from .curves import (
    FittedPolynomial as FittedPolynomial,
)
from .curves import (
    Polynomial as Polynomial,
)
from .datasheet import (
    POSITIVE as POSITIVE,
)
from .datasheet import (
    SMALLEST_RESISTOR as SMALLEST_RESISTOR,
)
from .datasheet import TYPICAL as TYPICAL
from .datasheet import (
    Datasheet as Datasheet,
)
from .datasheet import (
    Kind as Kind,
)
from .datasheet import (
    Tolerances as Tolerances,
)
from .e_series import (
    E12 as E12,
)
from .e_series import (
    E24 as E24,
)
from .e_series import (
    E24_PAIRS as E24_PAIRS,
)
from .e_series import (
    E96 as E96,
)
from .e_series import (
    E96_PAIRS as E96_PAIRS,
)
from .e_series import (
    EXACT as EXACT,
)
from .e_series import (
    SERIES as SERIES,
)
from .e_series import (
    Series as Series,
)
from .levels import (
    BEHAVIOURAL as BEHAVIOURAL,
)
from .levels import (
    MACRO_PARAMETERS as MACRO_PARAMETERS,
)
from .levels import (
    TRANSISTOR as TRANSISTOR,
)
from .levels import (
    Level as Level,
)
from .levels import (
    macro as macro,
)
from .levels import (
    ota_c as ota_c,
)
from .levels import (
    switched_capacitor as switched_capacitor,
)
from .technologies import (
    DifferentialPairs as DifferentialPairs,
)
from .technologies import (
    OpAmps as OpAmps,
)
from .technologies import (
    OtaC as OtaC,
)
from .technologies import (
    SwitchedCapacitors as SwitchedCapacitors,
)
from .technologies import (
    Technology as Technology,
)
from .technologies import (
    paired as paired,
)
