from .terminal import notes as notes
