from . import ode as ode, recurrent as recurrent, spice as spice
from .batch import BatchRun as BatchRun
from .ode import DOP853 as DOP853, OdeBackend as OdeBackend
from .overshoot import overshoot as overshoot
from .run import Run as Run
from .settling import Settling as Settling
from .status import not_settled as not_settled, settled as settled
from .tracking import Tracking as Tracking, tracking_error as tracking_error
