"""What it is like where torch is not installed."""

import sys

LAYERS = "ann_dc.backends.layers"
"""Room that needs torch."""


def forget_torch(monkeypatch) -> None:
    """Let everybody who asks for torch in this test find none."""
    for module in [name for name in sys.modules if name.startswith(LAYERS)]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "torch", None)
