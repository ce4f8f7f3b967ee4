import torch as torch

from .evaluator import TorchEvaluator as TorchEvaluator
from .fixed_order import LIBRARY as LIBRARY, applied as applied, total as total
from .flow import Flow as Flow, Reading as Reading
from .layer import CellLayer as CellLayer
from .metrics import (
    EliminationLayer as EliminationLayer,
    PyramidLayer as PyramidLayer,
    TimeConstantsLayer as TimeConstantsLayer,
)
from .tape import TorchTape as TorchTape
