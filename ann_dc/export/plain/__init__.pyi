from .reader import reader as reader
