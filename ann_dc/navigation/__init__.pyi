from .closed_loop import Journey as Journey, drive as drive
from .half_planes import half_planes as half_planes
from .planner_design import design_planner as design_planner
from .safety_filter import Shield as Shield
from .scenario import random_world as random_world
from .waypoint_planner import design_waypoint_planner as design_waypoint_planner
