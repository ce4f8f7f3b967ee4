"""Names of parts, neurons and inputs that a netlist accepts."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ann_dc.errors import NetworkError

RESERVED = ("src", "gnd", "null", "rst", "p1", "p2", "s", "sp", "sn")
"""Names that are reserved by the netlist."""

LONGEST = 200
"""Maximum length of a name in characters."""


def aliases(names: Iterable[str]) -> dict[str, str]:
    """Return valid netlist names: lower case, unique, without a double underscore.

    The names are those of parts, neurons and inputs. Raises `NetworkError` if a name has
    unprintable characters or is too long.

    Examples
    --------
    >>> aliases(["q.x", "Q X", "a*b"])
    {'q.x': 'q_x', 'Q X': 'q_x_v2', 'a*b': 'a_x_b'}
    """
    found: dict[str, str] = {}
    taken = set(RESERVED)
    for name in names:
        if not name.isprintable() or len(name) > LONGEST:
            raise NetworkError(f"circuit: {name!r} is no name that a netlist can carry")
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower().replace("*", "_x_")).strip("_") or "node"
        plain = plain[:40].strip("_") if plain[0].isalpha() else f"n_{plain[:40]}".strip("_")
        alias, number = plain, 2
        while not taken.isdisjoint({alias, f"n_{alias}"}):  # vos_n_x is that of x's inverter
            alias, number = f"{plain}_v{number}", number + 1
        taken |= {alias, f"n_{alias}"}
        found[name] = alias
    return found
