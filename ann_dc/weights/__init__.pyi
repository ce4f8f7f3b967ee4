from .matrix import to_matrix as to_matrix
from .network_file import load as load, save as save
