from .building import emulate as emulate, emulate_clamps as emulate_clamps
from .emulation import Emulation as Emulation
from .knee import knee as knee, knee_shift as knee_shift
from .nodes import AmplifierNodes as AmplifierNodes
from .noise_currents import (
    Currents as Currents,
    Noise as Noise,
    Place as Place,
    draw_noise as draw_noise,
    noise_sources as noise_sources,
    sources_of as sources_of,
    white as white,
)
from .noise_inputs import noise_input as noise_input, noisy_network as noisy_network
from .states import emulated_state as emulated_state, pole_spectrum as pole_spectrum
