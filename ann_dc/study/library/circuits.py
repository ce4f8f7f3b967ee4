"""Circuits: yield against the values of their parts, and agreement with the network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.records import Value
from ann_dc.study.study import Study
from ann_dc.validation import Count, Index, checked

BOARD: dict[str, Value] = {
    "circuit.level": "macro",
    "circuit.a0": 1e6,
    "circuit.gbw": 10e6,
    "circuit.bandwidth_margin": 10.0,
    "tolerance.resistor": 1e-3,
    "tolerance.gain": 1e-3,
    "tolerance.offset": 1e-4,
    "tolerance.product_offset": 1e-4,
}
"""Circuit with 10 MHz op amps and parts with errors of 0.1 % and 0.1 mV."""
FIGURES: dict[str, Sequence[float]] = {
    "tolerance.resistor": (1e-3, 2e-3, 3e-3, 4e-3, 6e-3, 1e-2),
    "tolerance.gain": (1e-3, 3e-3, 6e-3, 1e-2, 2e-2, 4e-2),
    "tolerance.offset": (1e-4, 3e-4, 6e-4, 1e-3, 2e-3, 4e-3),
    "tolerance.product_offset": (1e-4, 3e-4, 6e-4, 1e-3, 2e-3, 4e-3),
    "circuit.a0": (3e2, 1e3, 1.5e3, 3e3, 1e4, 1e5),
    "circuit.gbw": (3e6, 6e6, 8e6, 9e6, 10e6, 20e6),
    "circuit.bandwidth_margin": (5.0, 6.0, 7.0, 9.0, 11.0, 12.0, 15.0),
}
"""Datasheet values and tolerances that are varied, one at a time."""
SPEC: dict[str, float] = {"control_error": 0.02, "slowest_mode_seconds": 50e-6}
"""Specification: controls within 2 %, settled within 50 us."""


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
    """Declare studies of the yield against each datasheet value and tolerance.

    Circuit instances are drawn but not simulated. The behavioural emulation gives the equilibrium,
    and its eigenvalues give stability and settling time.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network.
    spec : mapping of metric to float or pair
        Limits of a good circuit; its metrics are measured. A circuit with an unstable equilibrium
        fails. Default: `SPEC`.
    figures : mapping of setting to sequence of float
        Varied values, one study each. ``circuit.`` values are common to all parts; ``tolerance.``
        values are sizes of random errors. Default: `FIGURES`.
    board : mapping of setting to Value
        Values of the other settings. Default: `BOARD`.
    samples : int
        Circuit instances per value, with equal draws for all values. Default 100.
    seed : int
        Seed of the samples. Default 0.

    Returns
    -------
    dict of str to Study
        Studies by varied setting.

    Examples
    --------
    >>> curves = yield_curves("double_integrator", samples=200)
    >>> len(curves), len(curves["circuit.a0"])
    (7, 1200)
    """
    return {
        name: Study(
            subject=subject,
            vary={name: [*values]},
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
    """Declare a study that compares simulated samples in ngspice with their emulation.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network.
    board : mapping of setting to Value
        Settings of the circuit. Default: `BOARD`.
    samples : int
        Circuit instances. With the same seed they are the first ones of `yield_curves`. Default 4.
    seed : int
        Seed of the samples. Default 0.

    Returns
    -------
    Study
        Two cases per circuit instance: 'run.backend' is "emulation", then "spice".

    Examples
    --------
    >>> from ann_dc.study.library import spot_check
    >>> [point.setting["run.backend"] for point in spot_check("car", samples=2).points()]
    ['emulation', 'emulation', 'spice', 'spice']
    """
    return Study(
        subject=subject,
        vary={"run.backend": ["emulation", "spice"]},
        fixed=board,
        metrics=["control_error", "seconds"],
        samples=samples,
        seed=seed,
        title="boards in ngspice and by emulation",
    )


REALISATIONS: dict[str, dict[str, Value]] = {
    "ODE": {"run.backend": "ode"},
    "recurrent": {"run.backend": "recurrent"},
    "ideal parts, ngspice": {"run.backend": "spice", "circuit.level": "behavioural"},
    "op amps, emulated": {"run.backend": "emulation", "circuit.level": "macro"},
    "op amps, ngspice": {"run.backend": "spice", "circuit.level": "macro"},
}
"""Settings by realisation."""
COMMON: dict[str, Value] = {"design.preconditioner": "diagonal"}
"""Preconditioner that all realisations support."""


@checked
def realisations(
    subject: str | OptimalControlProblem | Network,
    ranges: Mapping[str, tuple[float, float]],
    *,
    chosen: Mapping[str, Mapping[str, Value]] = REALISATIONS,
    fixed: Mapping[str, Value] = COMMON,
    samples: Count = 10,
    seed: Index = 0,
) -> dict[str, Study]:
    """Declare studies that compare settled controls and network time of realisations.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network.
    ranges : mapping of input to (low, high)
        Sampled inputs. Sample k has equal inputs in every realisation.
    chosen : mapping of str to mapping of setting to Value
        Settings by name of the realisation. Default: `REALISATIONS`.
    fixed : mapping of setting to Value
        Settings common to all realisations. Default: `COMMON`.
    samples : int
        Number of samples. Default 10.
    seed : int
        Seed of the samples. Default 0.

    Returns
    -------
    dict of str to Study
        Studies by realisation; record k of each is the same sample.

    Examples
    --------
    >>> studies = realisations("double_integrator", {"q_d.x": (0.5, 1.5)}, samples=3)
    >>> rows = {name: [*study.points()] for name, study in studies.items()}
    >>> [rows[name][2].setting["input.q_d.x"] == rows["ODE"][2].setting["input.q_d.x"]
    ...  for name in rows]
    [True, True, True, True, True]
    """
    return {
        name: Study(
            subject=subject,
            vary={f"input.{each}": (*ends,) for each, ends in ranges.items()},
            fixed={**fixed, **settings},
            metrics=["control_error", "control_settling_time", "seconds"],
            samples=samples,
            seed=seed,
            title=name,
        )
        for name, settings in chosen.items()
    }
