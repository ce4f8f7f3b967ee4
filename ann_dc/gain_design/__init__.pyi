from .eigenvalue_gradient import DenseFlow as DenseFlow, dense_metric as dense_metric
from .freeze import (
    Candidate as Candidate,
    candidate_of as candidate_of,
    compare as compare,
    downhill as downhill,
)
from .gains import Gains as Gains, apply_gains as apply_gains, hand_gains as hand_gains
from .grid_gains import SettledPoint as SettledPoint, stiffness_of as stiffness_of
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
from .rehearsal import rehearse as rehearse, rehearsed as rehearsed
from .row_weights import equilibrated as equilibrated
