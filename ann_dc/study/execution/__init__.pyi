from .apart import Apart as Apart, pickled as pickled
from .attempts import Attempt as Attempt, Task as Task, Work as Work, attempted as attempted
from .execution import Tally as Tally, execute as execute
from .script import Script as Script, loaded as loaded, own_script as own_script
