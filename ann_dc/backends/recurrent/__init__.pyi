import torch as torch

from .acceleration import Anderson as Anderson
from .backend import CHECK as CHECK
from .backend import OUTCOMES as OUTCOMES
from .backend import RecurrentBackend as RecurrentBackend
from .layer import RecurrentLayer as RecurrentLayer
from .ledger import DIVERGED as DIVERGED
from .ledger import SETTLED as SETTLED
from .ledger import Settled as Settled
from .orders import (
    ORDERS as ORDERS,
)
from .orders import (
    SIMULTANEOUS as SIMULTANEOUS,
)
from .orders import (
    STAGE_BY_STAGE as STAGE_BY_STAGE,
)
from .orders import (
    TWO_PHASE as TWO_PHASE,
)
from .orders import (
    Order as Order,
)
from .proposal import Proposal as Proposal
from .steps import (
    AdaptiveStep as AdaptiveStep,
)
from .steps import (
    FixedStep as FixedStep,
)
from .steps import (
    StepRule as StepRule,
)
from .steps import (
    StepState as StepState,
)
from .steps import (
    dual_limit as dual_limit,
)
