from .closed_loop import Journey as Journey, drive as drive
from .half_planes import (
    Ahead as Ahead,
    Margin as Margin,
    discs as discs,
    half_planes as half_planes,
)
from .network_planner import NetworkPlanner as NetworkPlanner
from .obstacles import Nearness as Nearness, Obstacle as Obstacle, disc as disc, polygon as polygon
from .planner import Driver as Driver, Plan as Plan, Planner as Planner, Situation as Situation
from .planner_design import design_planner as design_planner, planner_for as planner_for
from .shield import Shield as Shield
from .waypoint_planner import (
    WaypointPlanner as WaypointPlanner,
    design_waypoint_planner as design_waypoint_planner,
)
from .world import World as World, random_world as random_world
from .world_file import load_world as load_world
