from .planning import (
    LINEAR as LINEAR,
    NONLINEAR as NONLINEAR,
    Form as Form,
    Planning as Planning,
    leg_problem as leg_problem,
    planning_problem as planning_problem,
)
from .robot import Robot as Robot, car_robot as car_robot, unicycle_robot as unicycle_robot
