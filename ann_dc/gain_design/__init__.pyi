from .eigenvalue_gradient import DenseFlow as DenseFlow, dense_metric as dense_metric
from .freeze import (
    Candidate as Candidate,
    candidate_of as candidate_of,
    compare as compare,
    downhill as downhill,
)
from .knowledge import Knowledge as Knowledge
from .neighbourhood import SAMPLES as SAMPLES, neighbourhood as neighbourhood
from .procedure import Design as Design, design as design
from .refinement import (
    Freedom as Freedom,
    Variation as Variation,
    best_step as best_step,
    refined as refined,
)
from .rehearsal import rehearse as rehearse, rehearsed as rehearsed
from .rules import (
    COARSE as COARSE,
    KNOTS as KNOTS,
    NEARBY as NEARBY,
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Gains as Gains,
    Recipe as Recipe,
    SettledPoint as SettledPoint,
    apply_gains as apply_gains,
    closed_form as closed_form,
    equilibrated as equilibrated,
    hand_gains as hand_gains,
    presets_of as presets_of,
    stiffness_of as stiffness_of,
)
