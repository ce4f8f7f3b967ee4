"""Makes ``import problems`` and ``import reference`` work from every test folder."""

import sys
from pathlib import Path

from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))

settings.register_profile("shared", deadline=None)  # machines are shared: time is no property
settings.load_profile("shared")
