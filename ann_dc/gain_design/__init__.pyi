from .eigenvalue_gradient import DenseFlow as DenseFlow, dense_metric as dense_metric
from .gains import Gains as Gains, apply_gains as apply_gains, hand_gains as hand_gains
from .procedure import Design as Design, design as design
from .recipe import (
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Recipe as Recipe,
    closed_form as closed_form,
)
from .refinement import (
    Freedom as Freedom,
    Variation as Variation,
    best_step as best_step,
    refined as refined,
)
