from .backend import RecurrentBackend as RecurrentBackend
