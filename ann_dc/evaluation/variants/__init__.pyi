from .numbers import Numbers as Numbers, numbers_of as numbers_of
from .wiring import require_one_wiring as require_one_wiring
