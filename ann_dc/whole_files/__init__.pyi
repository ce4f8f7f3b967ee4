from .files import (
    LARGEST_TABLE as LARGEST_TABLE,
    as_output_error as as_output_error,
    check_new as check_new,
    make_folder as make_folder,
    read_table as read_table,
    read_whole as read_whole,
    write_folder as write_folder,
    write_whole as write_whole,
    writing_whole as writing_whole,
)
from .locks import Lock as Lock
