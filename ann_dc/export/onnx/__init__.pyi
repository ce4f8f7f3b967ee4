from .check import onnx_check as onnx_check
from .files import onnx_files as onnx_files
