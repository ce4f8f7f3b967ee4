from .decay import decay_rate as decay_rate
from .overshoot import overshoot as overshoot
