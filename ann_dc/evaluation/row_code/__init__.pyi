from .buses import Buses as Buses
from .residual_code import add_residuals as add_residuals
