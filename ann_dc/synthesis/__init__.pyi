from .synthesis import synthesize as synthesize
from .wiring import Wiring as Wiring
