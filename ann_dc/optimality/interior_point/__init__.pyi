from .barrier import Caution as Caution
from .search import Extremum as Extremum, interior_point as interior_point
