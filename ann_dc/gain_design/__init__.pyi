from .coarse_gains import Hats as Hats
from .gains import Gains as Gains
from .gains import apply_gains as apply_gains
from .gains import hand_gains as hand_gains
from .procedure import Design as Design
from .procedure import design as design
from .recipe import (
    WITH_COORDINATORS as WITH_COORDINATORS,
)
from .recipe import (
    WITHOUT_COORDINATORS as WITHOUT_COORDINATORS,
)
from .recipe import (
    Recipe as Recipe,
)
from .recipe import (
    closed_form as closed_form,
)
