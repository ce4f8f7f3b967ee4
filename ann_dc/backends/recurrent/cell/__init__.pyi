from .layer import CellLayer as CellLayer
