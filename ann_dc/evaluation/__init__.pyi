from .compiled import CompiledEvaluator as CompiledEvaluator
from .contract import Evaluator as Evaluator
from .domains import Bounds as Bounds
from .domains import DomainGuard as DomainGuard
from .loops import LOST as LOST
from .loops import RAN as RAN
from .loops import SETTLED as SETTLED
from .populations import kkt_point as kkt_point
from .populations import neuron_values as neuron_values
from .reference import (
    ReferenceEvaluator as ReferenceEvaluator,
)
from .reference import (
    evaluator as evaluator,
)
from .reference import (
    tape_with_penalty as tape_with_penalty,
)
from .rules import FLOOR as FLOOR
from .rules import RoleRows as RoleRows
from .tape import DUAL as DUAL
from .tape import FUNCTION as FUNCTION
from .tape import PRODUCT as PRODUCT
from .tape import SUM as SUM
from .tape import Tape as Tape
