from .nir_graph import nir_check as nir_check, nir_files as nir_files
from .torch_program import (
    torch_program_check as torch_program_check,
    torch_program_files as torch_program_files,
)
