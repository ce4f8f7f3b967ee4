from .files import onnx_files as onnx_files
