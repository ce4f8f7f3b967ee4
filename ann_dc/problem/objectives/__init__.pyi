from .measured import Measured as Measured
from .several import (
    Objectives as Objectives,
    Several as Several,
    Weights as Weights,
    objectives_of as objectives_of,
    weight_inputs as weight_inputs,
    weights_of as weights_of,
)
