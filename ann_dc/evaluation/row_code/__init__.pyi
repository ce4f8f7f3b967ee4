from .buses import Buses as Buses
from .residual_code import add_residuals as add_residuals
from .roots import add_scaling as add_scaling
