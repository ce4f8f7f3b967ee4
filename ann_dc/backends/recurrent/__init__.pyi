from .backend import RecurrentBackend as RecurrentBackend
from .layers import RecurrentLayer as RecurrentLayer
from .rules import (
    ORDERS as ORDERS,
    SIMULTANEOUS as SIMULTANEOUS,
    STAGE_BY_STAGE as STAGE_BY_STAGE,
    TWO_PHASE as TWO_PHASE,
    AdaptiveStep as AdaptiveStep,
    Anderson as Anderson,
    FixedStep as FixedStep,
)
