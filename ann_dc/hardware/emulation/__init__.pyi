from .building import emulate as emulate, emulate_clamps as emulate_clamps
from .diode_knee import knee_shift as knee_shift, with_diode_knee as with_diode_knee
from .noise_currents import Currents as Currents, Noise as Noise
from .states import emulated_state as emulated_state
