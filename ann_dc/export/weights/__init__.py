"""A network as one file of named arrays."""
