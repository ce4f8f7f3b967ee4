from .places import PlaceOptions as PlaceOptions
from .questions import BoardOptions as BoardOptions
