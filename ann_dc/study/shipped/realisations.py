"""Comparison of realisations of one network: ODE, recurrence and circuits."""

from __future__ import annotations

from collections.abc import Mapping

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.records import Value
from ann_dc.study.study import Study
from ann_dc.validation import Count, Index, checked

REALISATIONS: dict[str, dict[str, Value]] = {
    "ODE": {"run.backend": "ode"},
    "recurrent": {"run.backend": "recurrent"},
    "ideal parts, ngspice": {"run.backend": "spice", "circuit.level": "behavioural"},
    "op amps, emulated": {"run.backend": "emulation", "circuit.level": "macro"},
    "op amps, ngspice": {"run.backend": "spice", "circuit.level": "macro"},
}
"""Settings by realisation."""
FIXED: dict[str, Value] = {"design.kind": "diagonal"}
"""Preconditioner that all realisations support."""
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
        Settings common to all realisations. Default: `FIXED`.
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
            metrics=METRICS,
            samples=samples,
            seed=seed,
            title=name,
        )
        for name, settings in chosen.items()
    }
