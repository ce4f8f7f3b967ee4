from .contract import Evaluator as Evaluator
from .domains import Bounds as Bounds, DomainGuard as DomainGuard
from .interpreted import InterpretedEvaluator as InterpretedEvaluator
from .populations import kkt_point as kkt_point, neuron_values as neuron_values
from .reference import (
    ReferenceEvaluator as ReferenceEvaluator,
    evaluator as evaluator,
    tape_with_penalty as tape_with_penalty,
)
from .rules import (
    FLOOR as FLOOR,
    LOST as LOST,
    RAN as RAN,
    SETTLED as SETTLED,
    SMALLEST_POSITION as SMALLEST_POSITION,
    RoleRows as RoleRows,
)
from .tape import DUAL as DUAL, FUNCTION as FUNCTION, PRODUCT as PRODUCT, SUM as SUM, Tape as Tape
