from . import (
    onnx as onnx,
    reference as reference,
    results as results,
    weights as weights,
)
