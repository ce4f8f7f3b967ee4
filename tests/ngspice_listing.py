"""A deck as ngspice opens it: its own list of all elements, for others to be compared with."""

import re
import subprocess
from pathlib import Path

SUFFIXES = {"t": 1e12, "g": 1e9, "meg": 1e6, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9,
            "p": 1e-12, "f": 1e-15}  # fmt: skip


def expanded(deck: str, folder: Path) -> dict[str, list[str]]:
    """What follows the name of every element, by its name with the instances it is in.

    Parameters
    ----------
    deck : str
        Without commands.
    folder : Path
        With what it includes; the deck is written there.
    """
    commands = ".control\nlisting expand\nquit 0\n.endc\n.end\n"
    (folder / "listed.cir").write_text(re.sub(r"\.control.*", "", deck, flags=re.DOTALL)
                                       .removesuffix(".end\n") + commands)  # fmt: skip
    ran = subprocess.run(
        ["ngspice", "-n", "-b", "listed.cir"],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    rows = re.findall(r"^ *\d+ : (.*)$", ran.stdout.lower(), re.MULTILINE)
    words = [row.split() for row in rows]
    names = [re.sub(r"^\w\.", "", row[0]) for row in words]
    return {name: row[1:] for name, row in zip(names, words) if name[0] not in ".*"}


def number(text: str) -> float:
    """A number of the listing."""
    found = re.fullmatch(r"([-+.\de]+?)(meg|[tgkmunpf])?", text)
    return float(found[1]) * SUFFIXES.get(found[2], 1.0)
