from . import defects as defects
from .assembly import AmplifierNodes as AmplifierNodes
from .defects import (
    extra_pole as extra_pole,
)
from .defects import (
    gain_error as gain_error,
)
from .defects import (
    leak as leak,
)
from .defects import (
    mismatch as mismatch,
)
from .defects import (
    noise as noise,
)
from .defects import (
    offset as offset,
)
from .defects import (
    quantised as quantised,
)
from .defects import (
    rails as rails,
)
from .defects import (
    slew as slew,
)
from .emulation import (
    Emulation as Emulation,
)
from .emulation import (
    emulate as emulate,
)
from .emulation import (
    emulated_state as emulated_state,
)
from .emulation import (
    is_emulated as is_emulated,
)
from .emulation import (
    pole_spectrum as pole_spectrum,
)
from .noise_currents import (
    Currents as Currents,
)
from .noise_currents import (
    Noise as Noise,
)
from .noise_currents import (
    Place as Place,
)
from .noise_currents import (
    draw_noise as draw_noise,
)
from .noise_currents import (
    noise_sources as noise_sources,
)
from .noise_currents import (
    white as white,
)
from .noise_inputs import noise_input as noise_input
from .noise_inputs import noisy_network as noisy_network
