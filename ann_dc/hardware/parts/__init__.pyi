from . import levels as levels, presets as presets
from .conditions import Conditions as Conditions
from .datasheet import Datasheet as Datasheet, Kind as Kind, Tolerances as Tolerances
from .e_series import E24 as E24, E24_PAIRS as E24_PAIRS, E96 as E96
from .foundry import SKY130 as SKY130
from .levels import (
    BEHAVIOURAL as BEHAVIOURAL,
    TRANSISTOR as TRANSISTOR,
    Level as Level,
    macro as macro,
    switched_capacitor as switched_capacitor,
)
from .parasitics import Parasitics as Parasitics
