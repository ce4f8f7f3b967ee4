import torch as torch

from .acceleration import Anderson as Anderson
from .backend import (
    CHECK as CHECK,
    CHECK_ON_GPU as CHECK_ON_GPU,
    OUTCOMES as OUTCOMES,
    RecurrentBackend as RecurrentBackend,
)
from .layer import RecurrentLayer as RecurrentLayer
from .ledger import DIVERGED as DIVERGED, SETTLED as SETTLED, Settled as Settled
from .orders import (
    ORDERS as ORDERS,
    SIMULTANEOUS as SIMULTANEOUS,
    STAGE_BY_STAGE as STAGE_BY_STAGE,
    TWO_PHASE as TWO_PHASE,
    Order as Order,
)
from .proposal import Proposal as Proposal
from .steps import (
    AdaptiveStep as AdaptiveStep,
    FixedStep as FixedStep,
    StepRule as StepRule,
    StepState as StepState,
    dual_limit as dual_limit,
)
