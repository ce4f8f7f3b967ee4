from .acceleration import Anderson as Anderson
from .orders import (
    ORDERS as ORDERS,
    SIMULTANEOUS as SIMULTANEOUS,
    STAGE_BY_STAGE as STAGE_BY_STAGE,
    TWO_PHASE as TWO_PHASE,
)
from .steps import AdaptiveStep as AdaptiveStep, FixedStep as FixedStep
