"""One network in every realisation: integrated, as a recurrence, and as a circuit."""

from __future__ import annotations

from collections.abc import Mapping

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.records import Value
from ann_dc.study.study import Study
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, Index

REALISATIONS: dict[str, dict[str, Value]] = {
    "ODE": {"run.backend": "ode"},
    "recurrent": {"run.backend": "recurrent"},
    "ideal parts, ngspice": {"run.backend": "spice", "circuit.level": "behavioural"},
    "op amps, emulated": {"run.backend": "emulation", "circuit.level": "macro"},
    "op amps, ngspice": {"run.backend": "spice", "circuit.level": "macro"},
}
"""Settings of every realisation."""
FIXED: dict[str, Value] = {"design.kind": "time-constants"}
"""The metric that all of them can build."""
METRICS = ("control_error", "control_settling_time", "seconds")


@checked
def realisations(
    subject: str | OptimalControlProblem | Network,
    ranges: Mapping[str, tuple[float, float]],
    *,
    chosen: Mapping[str, Mapping[str, Value]] = REALISATIONS,
    fixed: Mapping[str, Value] = FIXED,
    samples: Count = 10,
    seed: Index = 0,
) -> dict[str, Study]:
    """Do all realisations of a network settle to the same controls, in the same network time?

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
    ranges : mapping of input to (low, high)
        Inputs that are drawn; sample k has the same ones in every realisation.
    chosen : mapping of str to mapping of setting to Value
        Realisations by their names.
    fixed : mapping of setting to Value
        Settings that all of them share.
    samples : int
    seed : int

    Returns
    -------
    dict of str to Study
        By the name of the realisation; row k of each is the same sample.

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
            over={f"input.{each}": (*ends,) for each, ends in ranges.items()},
            fixed={**fixed, **settings},
            metrics=METRICS,
            samples=samples,
            seed=seed,
            title=name,
        )
        for name, settings in chosen.items()
    }
