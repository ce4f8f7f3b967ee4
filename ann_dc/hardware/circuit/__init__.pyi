from .circuit import Parameter as Parameter, Quantity as Quantity, circuit_of as circuit_of
from .scaling import ProbeRun as ProbeRun, ScalingRules as ScalingRules, scale as scale
