from .continuous import (
    Integration as Integration,
    LaneEnds as LaneEnds,
    advance_lanes as advance_lanes,
)
from .group import Found as Found, Group as Group, Samples as Samples
from .orders import Scratch as Scratch
from .recurrence import (
    Looks as Looks,
    Recurrence as Recurrence,
    StepLengths as StepLengths,
    recur_lanes as recur_lanes,
)
from .samples import samples_of as samples_of
