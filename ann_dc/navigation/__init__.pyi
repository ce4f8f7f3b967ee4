from .closed_loop import ClosedLoopRun as ClosedLoopRun, drive as drive
from .half_planes import half_planes as half_planes
from .planner_design import design_planner as design_planner
from .safety_filter import SafetyFilter as SafetyFilter
from .scenario import random_scenario as random_scenario
from .waypoint_planner import design_waypoint_planner as design_waypoint_planner
