from . import (
    devices as devices,
    drawings as drawings,
    fixed_point as fixed_point,
    netlists as netlists,
    onnx as onnx,
    plain as plain,
    reference as reference,
    runtimes as runtimes,
)
from .catalogue import FORMATS as FORMATS
from .exporting import (
    Exported as Exported,
    export_network as export_network,
    settings_from as settings_from,
)
from .formats import Format as Format
from .inspecting import Inspection as Inspection, inspect_export as inspect_export
