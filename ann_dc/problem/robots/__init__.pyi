from .planning import Planning as Planning, planning_problem as planning_problem
from .robot import Robot as Robot, car_robot as car_robot, unicycle_robot as unicycle_robot
