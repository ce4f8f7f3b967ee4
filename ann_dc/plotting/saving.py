"""Atomic and reproducible output of figures as PNG files."""

from __future__ import annotations

import io
from pathlib import Path

from matplotlib.figure import Figure

from ann_dc.files import make_folder, write_whole
from ann_dc.plotting.controls import controls
from ann_dc.plotting.settling import settling
from ann_dc.plotting.spectrum import spectrum
from ann_dc.plotting.trajectory import trajectory
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked


@checked
def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as a PNG file; equal figures give equal bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure to write.
    path : str or Path
        File. Missing folders are created.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    OutputError
        If the folder cannot be created or the file cannot be written.
    """
    path = Path(path)
    make_folder(path.parent)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=150, metadata={"Software": None})
    write_whole(path, stream.getvalue())
    return path


@checked
def save_all(solution: Solution, folder: str | Path) -> list[Path]:
    """Write all four figures of a solution as PNG files into a folder.

    Parameters
    ----------
    solution : Solution
        Solution to plot.
    folder : str or Path
        Folder; created if missing.

    Returns
    -------
    list of Path
        trajectory.png, controls.png, settling.png, spectrum.png.

    Raises
    ------
    OutputError
        If the folder cannot be created or written.
    """
    figures = {
        "trajectory": trajectory(solution),
        "controls": controls(solution),
        "settling": settling(solution),
        "spectrum": spectrum(solution),
    }
    return [save(figure, Path(folder) / f"{name}.png") for name, figure in figures.items()]
