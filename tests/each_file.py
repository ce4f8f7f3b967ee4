"""A test of source files that runs folder by folder: one of each file costs more than it tests."""

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def of_every_file(paths: Iterable[Path]) -> Callable[[Callable[[Path], None]], Callable]:
    """Turn what holds for a file into a test of every folder that has some of these files."""
    folders: dict[Path, list[Path]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path)

    def for_each(holds: Callable[[Path], None]) -> Callable:
        @pytest.mark.parametrize("folder", folders, ids=lambda path: str(path.relative_to(ROOT)))
        def test(folder: Path) -> None:
            wrong = []
            for path in folders[folder]:
                try:
                    holds(path)
                except AssertionError as error:
                    wrong.append(f"{path.name}: {error}")
            assert wrong == []

        test.__name__, test.__doc__ = holds.__name__, holds.__doc__
        return test

    return for_each
