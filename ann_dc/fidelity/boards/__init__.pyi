from .corners import Corner as Corner, corners as corners
