from .backend import (
    CHECK as CHECK,
    CHECK_ON_GPU as CHECK_ON_GPU,
    RecurrentBackend as RecurrentBackend,
)
from .layers import (
    DIVERGED as DIVERGED,
    OUTCOMES as OUTCOMES,
    SETTLED as SETTLED,
    Proposal as Proposal,
    RecurrentLayer as RecurrentLayer,
    Settled as Settled,
    StepState as StepState,
    dual_limit as dual_limit,
)
from .rules import (
    ORDERS as ORDERS,
    SIMULTANEOUS as SIMULTANEOUS,
    STAGE_BY_STAGE as STAGE_BY_STAGE,
    TWO_PHASE as TWO_PHASE,
    AdaptiveStep as AdaptiveStep,
    Anderson as Anderson,
    FixedStep as FixedStep,
    Order as Order,
    StepLengths as StepLengths,
    StepRule as StepRule,
)
