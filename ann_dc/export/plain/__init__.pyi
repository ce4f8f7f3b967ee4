from .reader import reader as reader
from .tables import csv_check as csv_check, csv_files as csv_files
from .weight_files import weights_check as weights_check, weights_files as weights_files
