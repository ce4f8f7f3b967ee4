from .acceleration import Anderson as Anderson
from .orders import (
    ORDERS as ORDERS,
    SIMULTANEOUS as SIMULTANEOUS,
    STAGE_BY_STAGE as STAGE_BY_STAGE,
    TWO_PHASE as TWO_PHASE,
    Order as Order,
    check_order as check_order,
)
from .steps import (
    AdaptiveStep as AdaptiveStep,
    FixedStep as FixedStep,
    StepLengths as StepLengths,
    StepRule as StepRule,
    above_limit as above_limit,
)
