"""The command line: `ann-dc solve`, `coordinate`, `circuit`, `ladder`, `show`, `plants`, ..."""

from ann_dc.cli.app import main

__all__ = ["main"]
