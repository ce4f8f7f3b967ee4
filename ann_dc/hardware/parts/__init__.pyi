from . import levels as levels, presets as presets
from .board_models import MACRO_PARAMETERS as MACRO_PARAMETERS
from .conditions import (
    COLDEST as COLDEST,
    CORNERS as CORNERS,
    HOTTEST as HOTTEST,
    NOMINAL as NOMINAL,
    ROOM as ROOM,
    Conditions as Conditions,
)
from .datasheet import (
    POSITIVE as POSITIVE,
    SMALLEST_RESISTOR as SMALLEST_RESISTOR,
    TYPICAL as TYPICAL,
    Datasheet as Datasheet,
    Kind as Kind,
    Tolerances as Tolerances,
)
from .e_series import (
    E12 as E12,
    E24 as E24,
    E24_PAIRS as E24_PAIRS,
    E96 as E96,
    E96_PAIRS as E96_PAIRS,
    EXACT as EXACT,
    SERIES as SERIES,
    Series as Series,
)
from .foundry import SKY130 as SKY130, passive as passive
from .levels import (
    BEHAVIOURAL as BEHAVIOURAL,
    TRANSISTOR as TRANSISTOR,
    Level as Level,
    macro as macro,
    ota_c as ota_c,
    switched_capacitor as switched_capacitor,
    transistor as transistor,
)
from .parasitics import (
    BOARD_PARAMETERS as BOARD_PARAMETERS,
    MultiplierLaw as MultiplierLaw,
    Parasitics as Parasitics,
    board_parameters as board_parameters,
)
from .technologies import (
    DifferentialPairs as DifferentialPairs,
    OpAmps as OpAmps,
    OtaC as OtaC,
    SwitchedCapacitors as SwitchedCapacitors,
    Technology as Technology,
    paired as paired,
)
from .transistors import GILBERT as GILBERT, transistor_sheet as transistor_sheet
