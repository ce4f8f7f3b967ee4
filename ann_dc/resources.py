"""Where the files lie that are not Python: under the package, or in a checkout beside it."""

from __future__ import annotations

from pathlib import Path

from ann_dc.hints.checked import checked


@checked
def circuits_path() -> Path:
    """The folder of the SPICE library.

    Returns
    -------
    pathlib.Path
        With the folders ``cells`` and ``models``.

    Raises
    ------
    FileNotFoundError
        If the installation is incomplete.

    Examples
    --------
    >>> sorted(part.name for part in (circuits_path() / "models" / "presets").glob("tl*.lib"))
    ['tl072_ad633.lib']
    """
    package = Path(__file__).resolve().parent
    for folder in (package / "circuits", package.parent / "circuits"):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(
        f"the SPICE library is missing: neither {package / 'circuits'} nor "
        f"{package.parent / 'circuits'} exists; install ann_dc again"
    )
