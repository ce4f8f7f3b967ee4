"""``python -m ann_dc`` is the command ``ann-dc``."""

from ann_dc.cli import main

if __name__ == "__main__":
    main()
