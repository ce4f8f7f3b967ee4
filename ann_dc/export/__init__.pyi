from . import (
    devices as devices,
    drawings as drawings,
    fixed_point as fixed_point,
    netlists as netlists,
    onnx as onnx,
    reference as reference,
    runtimes as runtimes,
)
from .catalogue import FORMATS as FORMATS, inspect_export as inspect_export
from .exporting import export_network as export_network
