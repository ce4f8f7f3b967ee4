from .generated import GeneratedEvaluator as GeneratedEvaluator
from .lanes import Cell as Cell, Lanes as Lanes
from .plan import Axis as Axis, refusal as refusal
