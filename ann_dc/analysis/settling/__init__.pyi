from .modes import Modes as Modes
from .predicted import predicted_settling as predicted_settling
