from .building import emulate as emulate, emulate_clamps as emulate_clamps
from .diode_knee import knee as knee, knee_shift as knee_shift
from .noise_currents import Currents as Currents, Noise as Noise
from .states import emulated_state as emulated_state
