from .choice import (
    Sizing as Sizing,
    check_currents as check_currents,
    sized_circuit as sized_circuit,
)
from .clamps import (
    GIVEN as GIVEN,
    check_clamps as check_clamps,
    holding_margin as holding_margin,
)
from .cures import cure as cure
from .margins import (
    FOLLOWING as FOLLOWING,
    HIGHEST as HIGHEST,
    SPARE as SPARE,
    check_following as check_following,
    following_margin as following_margin,
    is_stable as is_stable,
    least_margin as least_margin,
)
from .rail_rows import (
    BANDWIDTH as BANDWIDTH,
    FASTER as FASTER,
    GAIN as GAIN,
    INTO as INTO,
    SLOWER as SLOWER,
    intervals_of_inputs as intervals_of_inputs,
    with_rail_rows as with_rail_rows,
)
from .resistors import (
    CURRENT as CURRENT,
    GROUND as GROUND,
    SHARE as SHARE,
    STIFF as STIFF,
    fitting_resistor as fitting_resistor,
)
