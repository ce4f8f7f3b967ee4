from .freeze import (
    Candidate as Candidate,
    candidate_of as candidate_of,
    compare as compare,
    downhill as downhill,
)
from .gains import Gains as Gains, apply_gains as apply_gains, hand_gains as hand_gains
from .grid_gains import SettledPoint as SettledPoint, stiffness_of as stiffness_of
from .procedure import ALL_KINDS as ALL_KINDS, Design as Design, design as design
from .recipe import (
    WITH_COORDINATORS as WITH_COORDINATORS,
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
    Recipe as Recipe,
    closed_form as closed_form,
)
from .rehearsal import rehearse as rehearse, rehearsed as rehearsed
from .row_weights import equilibrated as equilibrated
