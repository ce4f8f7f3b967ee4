"""Entry point of ``python -m ann_dc``, equivalent to the command ``ann-dc``."""

from ann_dc.cli import main

if __name__ == "__main__":
    main()
