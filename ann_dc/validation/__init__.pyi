from .checked import checked as checked
