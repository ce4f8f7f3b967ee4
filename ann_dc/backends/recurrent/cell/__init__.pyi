from .evaluator import TorchEvaluator as TorchEvaluator
from .flow import Flow as Flow, Reading as Reading
from .layer import CellLayer as CellLayer
from .metrics import PyramidLayer as PyramidLayer
from .tape import TorchTape as TorchTape
