from .handed_on import HandedOn as HandedOn
from .step_length import (
    StepLength as StepLength,
    mean_length as mean_length,
    stage_times as stage_times,
)
from .timed_plants import car_free_time as car_free_time, pendulum_free_time as pendulum_free_time
