from .pack import pack_check as pack_check, pack_files as pack_files
