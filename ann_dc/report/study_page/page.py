"""HTML page of a study: one local file without external requests or scripts.

Content of the store appears as text or data, never as markup: the template ``assets/page.html``
escapes every text. A security policy in the page head lists the hashes of permitted scripts and
forbids every request, so injected text is never executed.

The records are a binary table: JSON header and raw columns, compressed with gzip, as base64.

    length of the head (4 bytes) | head | padding to 8 bytes | columns, each padded to 8 bytes

All numbers are little-endian. A numeric column has 8 bytes per record. A text column has the codes
of its values, in 1, 2 or 4 bytes per record.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import os
import struct
from collections.abc import Iterable
from contextlib import nullcontext
from importlib import import_module, resources
from pathlib import Path
from typing import Any

import numpy as np

import ann_dc
from ann_dc.errors import JinjaMissing, PandasMissing, PlotlyMissing
from ann_dc.files import write_whole
from ann_dc.progress import Progress, silent
from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.report.study_page import sections
from ann_dc.report.study_page.choice import chosen
from ann_dc.report.study_page.figure import percent
from ann_dc.report.study_page.over_time import RESIDUALS, categories_of
from ann_dc.study.store import Store
from ann_dc.study.table import NO_RESULT
from ann_dc.validation import checked

PACKAGES = {"pandas": PandasMissing, "plotly.offline": PlotlyMissing, "jinja2": JinjaMissing}
"""Packages of the extra `study` that a page needs, with the error if one is missing."""
LARGEST_TABLE = 200_000
"""Largest number of records in a page; statistics and figures use all records."""


@checked
def write_study_page(
    study: Store | str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    progress: Progress = silent,
) -> None:
    """Write the HTML page of a finished or unfinished study into an existing folder.

    Parameters
    ----------
    study : path-like or Store
        Folder of the study, or its open store.
    path : path-like
        HTML page.
    progress : Progress
        Callable that receives one progress line at a time. Default: no output.

    Raises
    ------
    StoreError
        If the folder does not contain a study.
    OutputError
        If the file cannot be written.
    PandasMissing, PlotlyMissing, JinjaMissing
        If a package is not installed.

    Examples
    --------
    >>> import ann_dc, tempfile
    >>> study = ann_dc.Study(
    ...     subject="double_integrator", vary={"nonideal.mismatch": [0.001, 0.01]}, samples=2
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = study.run(folder, workers=0)
    ...     write_study_page(folder, Path(folder, "report.html"))
    """
    _check_packages()
    with nullcontext(study) if isinstance(study, Store) else Store.open(study) as store:
        progress("reading the database")
        found = Findings.of(store)
    write_whole(path, page_of(found, progress=progress).encode("utf-8"))


def write_residuals(store: Store, page: str | os.PathLike[str]) -> list[Path]:
    """Write the residuals over time next to a page, as PDF and SVG; nothing without trajectories.

    Returns the files. Raises `OutputError` if a file cannot be written.
    """
    found = categories_of(Findings.of(store), RESIDUALS)
    if not found:
        return []
    from ann_dc.plotting.convergence import Curve, medians
    from ann_dc.plotting.style import save

    curves = {part.label: [Curve(c.times, c.values) for c in part.curves] for part in found}
    centres = {part.label: Curve(part.times, part.median) for part in found if len(part.times)}
    figure, place = medians(curves, centres), Path(page)
    names = (place.with_name(f"{place.stem}_residuals{suffix}") for suffix in (".pdf", ".svg"))
    return [save(figure, name) for name in names]


def page_of(found: Findings, *, progress: Progress = silent) -> str:
    """Return the HTML page of a study; equal data give equal text.

    Raises `PlotlyMissing` or `JinjaMissing` if a package is not installed.
    """
    _check_packages()
    from plotly.offline import get_plotlyjs, get_plotlyjs_version

    progress("figures")
    figures, left_out = chosen(found)
    progress("table")
    scripts = [
        _as_read(text) for text in (get_plotlyjs(), _asset("table.js"), _asset("figures.js"))
    ]
    data = {  # no "<" of a text can end the element of its script
        "figure-data": json.dumps([figure.content() for figure in figures]),
        "table-data": pack(found.columns.values(), min(len(found), LARGEST_TABLE)),
        "command": json.dumps(found.command),
    }
    return _template().render(
        found=found, sections=sections, figures=figures, left_out=left_out, no_result=NO_RESULT,
        largest=LARGEST_TABLE, style=_asset("page.css"), scripts=scripts,
        written_by=f"ann_dc {ann_dc.__version__} with plotly.js {get_plotlyjs_version()}",
        data={name: text.replace("<", "\\u003c") for name, text in data.items()},
        hashes=" ".join(f"'sha256-{_digest(text)}'" for text in scripts),
    )  # fmt: skip


def _check_packages() -> None:
    for name, error in PACKAGES.items():
        try:
            import_module(name)
        except ImportError as cause:
            package = name.partition(".")[0]
            raise error(
                f"the page of a study needs {package}: pip install 'ann-dc[study]'"
            ) from cause


def _template() -> Any:
    """Return the template of the page, which escapes every text that is not marked as safe."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, loader=FunctionLoader(_asset),
    )  # fmt: skip
    environment.filters |= {
        "number": sections.number, "percent": percent, "plain": sections.plain,
    }  # fmt: skip
    return environment.get_template("page.html")


def _asset(name: str) -> str:
    place = resources.files("ann_dc.report.study_page") / "assets" / name
    return place.read_text(encoding="utf-8")


def _as_read(script: str) -> str:
    """Return a script exactly as a browser reads it from the page."""
    lines = script.replace("\r\n", "\n").replace("\r", "\n")
    return lines.replace("</script", "<\\/script").replace("<!--", "\\x3c!--")


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


ALIGNED = 8
"""Alignment of columns in bytes."""


def pack(columns: Iterable[Column], rows: int) -> str:
    """Return the first `rows` records of a table as base64 text."""
    heads, blocks, offset = [], [], 0
    for column in columns:
        values = _values(column)[:rows]
        head = {"name": column.name, "unit": column.unit, "says": column.says}
        words = {} if column.numbers is not None else {"words": list(column.words)}
        heads.append({**head, "kind": values.dtype.name, "offset": offset, **words})
        blocks.append(_padded(values.tobytes()))
        offset += len(blocks[-1])
    head = json.dumps({"rows": rows, "columns": heads}).encode("ascii")
    whole = b"".join([_padded(struct.pack("<I", len(head)) + head), *blocks])
    return base64.b64encode(gzip.compress(whole, 6, mtime=0)).decode("ascii")


def _values(column: Column) -> np.ndarray:
    if column.numbers is not None:
        return column.numbers.astype("<f8")
    count = len(column.words)
    kind = "<u1" if count <= 2**8 else "<u2" if count <= 2**16 else "<u4"
    return column.places.astype(kind)


def _padded(content: bytes) -> bytes:
    return content + bytes(-len(content) % ALIGNED)
