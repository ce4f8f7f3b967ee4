from .checked import checked as checked
from .checks import check_of as check_of
from .complaints import Complaint as Complaint
from .values import (
    Count as Count,
    Finite as Finite,
    FloatOrNan as FloatOrNan,
    Index as Index,
    NotEmpty as NotEmpty,
    NotNegative as NotNegative,
    OrNan as OrNan,
    Own as Own,
    Positive as Positive,
    PositiveFinite as PositiveFinite,
    Range as Range,
    Shape as Shape,
    Share as Share,
    State as State,
)
from .words import given_words as given_words, such_as as such_as
