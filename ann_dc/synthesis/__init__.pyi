from .adjoint import gradient as gradient
from .assembly import assemble as assemble
from .expressions import signal_of as signal_of
from .row import start_values as start_values
from .signals import add as add, partial as partial, scaled as scaled, times as times
from .synthesis import synthesize as synthesize
from .wiring import Wiring as Wiring
