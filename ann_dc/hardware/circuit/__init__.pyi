from .circuit import circuit_of as circuit_of
from .parameters import Parameter as Parameter, Quantity as Quantity
from .scaling import ProbeRun as ProbeRun, ScalingRules as ScalingRules, scale as scale
