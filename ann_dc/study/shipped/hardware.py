"""Which share of boards meets a spec, against the figures of the parts that they are made of.

A board is drawn, not run: the network that its circuit is says where the board settles, and the
eigenvalues there whether it stays and how fast it came.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.records import Value
from ann_dc.study.study import Study
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, Index

BOARD: dict[str, Value] = {
    "circuit.level": "macro",
    "circuit.a0": 1e6,
    "circuit.gbw": 10e6,
    "circuit.margin": 10.0,
    "tolerance.resistor": 1e-3,
    "tolerance.gain": 1e-3,
    "tolerance.offset": 1e-4,
    "tolerance.product_offset": 1e-4,
}
"""A board of op amps of 10 MHz with parts that are 0.1 % and 0.1 mV off."""
FIGURES: dict[str, Sequence[float]] = {
    "tolerance.resistor": (1e-3, 2e-3, 3e-3, 4e-3, 6e-3, 1e-2),
    "tolerance.gain": (1e-3, 3e-3, 6e-3, 1e-2, 2e-2, 4e-2),
    "tolerance.offset": (1e-4, 3e-4, 6e-4, 1e-3, 2e-3, 4e-3),
    "tolerance.product_offset": (1e-4, 3e-4, 6e-4, 1e-3, 2e-3, 4e-3),
    "circuit.a0": (3e2, 1e3, 1.5e3, 3e3, 1e4, 1e5),
    "circuit.gbw": (3e6, 6e6, 8e6, 9e6, 10e6, 20e6),
    "circuit.margin": (5.0, 6.0, 7.0, 9.0, 11.0, 12.0, 15.0),
}
"""What is varied of a board, one figure at a time."""
SPEC: dict[str, float] = {"control_error": 0.02, "slowest_mode_seconds": 50e-6}
"""Controls within 2 %, and there within 50 us."""


@checked
def yield_curves(
    subject: str | OptimalControlProblem | Network,
    *,
    spec: Mapping[str, Any] = SPEC,
    figures: Mapping[str, Sequence[float]] = FIGURES,
    board: Mapping[str, Value] = BOARD,
    samples: Count = 100,
    seed: Index = 0,
) -> dict[str, Study]:
    """Which share of boards meets a spec, against each figure of their parts?

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
    spec : mapping of metric to float or pair
        Of a board that is good; its names are what is measured. A board whose settled point
        repels is none.
    figures : mapping of setting to sequence of float
        What is varied, one study each: ``circuit.`` what all parts have in common, ``tolerance.``
        the sizes of the errors that are drawn.
    board : mapping of setting to Value
        What the other figures are meanwhile.
    samples : int
        Boards at every value; the same draws at all of them.
    seed : int

    Returns
    -------
    dict of str to Study
        By the figure that is varied.

    Examples
    --------
    >>> curves = yield_curves("double_integrator", samples=200)
    >>> len(curves), len(curves["circuit.a0"])
    (7, 1200)
    """
    return {
        name: Study(
            subject=subject,
            over={name: [*values]},
            fixed={n: value for n, value in board.items() if n != name},
            metrics=[*spec],
            spec=spec,
            samples=samples,
            seed=seed,
            title=f"yield against {name}",
        )
        for name, values in figures.items()
    }


@checked
def spot_check(
    subject: str | OptimalControlProblem | Network,
    *,
    board: Mapping[str, Value] = BOARD,
    samples: Count = 4,
    seed: Index = 0,
) -> Study:
    """Do drawn boards do in ngspice what their emulation says?

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
    board : mapping of setting to Value
    samples : int
        Boards; with the same seed the first ones of `yield_curves`.
    seed : int

    Returns
    -------
    Study
        Every board twice: 'run.backend' is "emulation", then "spice".

    Examples
    --------
    >>> from ann_dc.study.shipped import spot_check
    >>> [point.setting["run.backend"] for point in spot_check("car", samples=2).points()]
    ['emulation', 'emulation', 'spice', 'spice']
    """
    return Study(
        subject=subject,
        over={"run.backend": ["emulation", "spice"]},
        fixed=board,
        metrics=["control_error", "seconds"],
        samples=samples,
        seed=seed,
        title="boards in ngspice beside their emulation",
    )
