"""Solution in the problem's names: values, status, settling time, certificate."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.backends.run import Run
from ann_dc.backends.status import Outcome, Status
from ann_dc.backends.trajectory import Trajectory
from ann_dc.dataclass_pickling import Record
from ann_dc.decomposition.equations import StageEquations
from ann_dc.errors import UnknownNameError, such_as
from ann_dc.evaluation.populations import kkt_point, neuron_values
from ann_dc.gain_design.procedure import Design
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import Certificate, certify
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.serialisation import written
from ann_dc.problem.step_length import StepLength, mean_length, stage_times
from ann_dc.si_prefixes import lasting
from ann_dc.solution.saved_result import save_result
from ann_dc.summaries import summarised
from ann_dc.timing import phase
from ann_dc.validation import checked


@such_as("ann_dc.solve(problem)")
@checked
@summarised(
    lambda self: {
        "problem": self.problem.name,
        "status": self.status,
        "cost": f"{self.objective:.6g}",
        "settling time": f"{self.settling_time:.4g}",
        "KKT residual": f"{self.kkt_residual:.1e}",
        "certified": f"{'yes' if self.certified else 'no'} ({self.verdict})",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(Record):
    """Result of a network run for an optimal-control problem.

    ``solution["phi"]`` is a state over N + 1 stages, and ``solution["nu"]`` a control over N
    stages. ``solution["mu.phi"]`` is one neuron over the stages. ``solution["mu"]`` is a whole
    population with one column per component, unless a state or control has that name and takes
    precedence. ``solution["z.disc"]`` is the multiplier zeta of the inequality ``disc`` at every
    stage. ``solution.populations["u"]`` is always the population. A step length chosen by the
    network is available by its symbol, over N stages.

    Attributes
    ----------
    problem : OptimalControlProblem
        Solved problem.
    equations : StageEquations
        Form of the equations that was wired.
    network : Network
        Network with fixed gains that ran.
    run : Run
        Trajectory, status and settling time of the run.
    certificate : Certificate
        Optimality certificate of the final point, computed from the problem alone.
    design : Design or None
        Gain design; None if the gains were given.

    Examples
    --------
    >>> from ann_dc import plants, solve
    >>> solution = solve(plants.double_integrator(N=5))
    >>> solution.certified, solution.verdict
    (True, 'strict local minimum')
    >>> solution["a"][:2].round(3).tolist(), solution.populations["mu"].shape
    ([20.0, 10.0], (5, 2))
    """

    problem: OptimalControlProblem
    equations: StageEquations
    network: Network
    run: Run
    certificate: Certificate
    design: Design | None

    @property
    def status(self) -> Status:
        """Status at the end of the run."""
        return self.run.status

    @cached_property
    def trajectory(self) -> Trajectory:
        """Neurons over network time, with the units of the problem."""
        return self.run.trajectory.measured_in(units_of(self.problem, self.network))

    @property
    def objective(self) -> float:
        """Total cost E in the user's units."""
        return self.certificate.objective

    @property
    def kkt_residual(self) -> float:
        """Relative first-order residual, from exact derivatives of the problem."""
        return self.certificate.kkt_residual

    @property
    def rollout_error(self) -> float:
        """Distance from q_d of the terminal state simulated with the controls alone."""
        return self.certificate.rollout_error

    @property
    def certified(self) -> bool:
        """True if the solution is an optimum: settled, or as ``status`` describes."""
        reported = (Outcome.SETTLED, Outcome.FOUND, Outcome.STOPPED)
        return self.status.outcome in reported and self.certificate.certified

    @property
    def verdict(self) -> str:
        """Reason for which the solution is certified or not."""
        if self.status.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED):
            return self.status.outcome.value
        if self.status.settled:
            return self.certificate.reason
        known = f"{self.certificate.reason}, but " if self.certified else ""
        return f"{known}the network did not settle"

    @cached_property
    def time(self) -> np.ndarray:
        """Start times of the stages and the final time, shape (N+1,), in the unit of dt."""
        return stage_times(self.problem.dt, self.populations["q"].T)

    @property
    def step_length(self) -> float:
        """Length of a stage: dt, or the chosen length (its mean if not settled)."""
        return mean_length(self.problem.dt, self.populations["q"].T)

    @property
    def total_time(self) -> float:
        """Total time: N times the step length."""
        return float(self.time[-1])

    @property
    def chosen_step(self) -> str:
        """Description of step length and total time, with the active bound, if any."""
        problem, dt = self.problem, self.problem.dt
        length, total = (problem.timed(f"{v:.6g}") for v in (self.step_length, self.total_time))
        bound = dt.bound_at(self.step_length) if isinstance(dt, StepLength) else ""
        at = f" (its {bound} bound)" if bound else ""
        return f"{length}{at}, {lasting(problem.horizon)} {total}"

    @property
    def settling_time(self) -> float:
        """Network time after which the KKT residual stays below tolerance, or nan."""
        return self.run.settling_time

    @cached_property
    def spectrum(self) -> Spectrum:
        """Eigenvalues of the network with fixed gains at its final state."""
        return spectrum(self.network, self.trajectory.final)

    @property
    def normalised_settling_time(self) -> float:
        """Settling time times the spectral radius: the requirement on hardware speed."""
        return self.settling_time * self.spectrum.radius if self.status.settled else float("nan")

    @property
    def settling_in_fastest_time_constants(self) -> float:
        """Deprecated name of `normalised_settling_time`; removed in 0.2."""
        warnings.warn(
            "settling_in_fastest_time_constants: use normalised_settling_time",
            DeprecationWarning,
            stacklevel=2,
        )
        return self.normalised_settling_time

    @cached_property
    def populations(self) -> Mapping[str, np.ndarray]:
        """Populations q (N+1, n), u (N, m), t, mu and beta (N, n) in the user's units.

        With inequalities also z (N, rows); z_end (N, rows) counts in the last stage. The mapping is
        read-only. Names are always those of populations, whereas in ``solution[name]`` a state or
        control called ``u`` takes precedence.

        Raises
        ------
        UnknownNameError
            On access by a name that is not a population; the message lists the names.
        """
        values = _Populations(neuron_values(self.network, self.trajectory.final))
        values["q"] = np.vstack([values["q"], values["t"][-1:]])
        for array in values.values():
            array.setflags(write=False)
        return MappingProxyType(values)

    @cached_property
    def _by_name(self) -> dict[str, np.ndarray]:
        names: dict[str, np.ndarray] = {}
        for population, values in self.populations.items():
            own = [n.name for n in self.network.cell.neurons if n.population == population]
            names[population] = values
            names |= dict(zip(own, values.T))
        for population, symbols in (("q", self.problem.states), ("u", self.problem.controls)):
            for symbol in symbols:  # last, so that a control called u means itself
                names[str(symbol)] = names[f"{population}.{symbol}"]
        if isinstance(self.problem.dt, StepLength):
            names[str(self.problem.dt.symbol)] = np.diff(self.time)
        return names

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the values over the stages of a state, control, population or neuron.

        A state or control takes precedence over a population of the same name; see `populations`.

        Raises
        ------
        UnknownNameError
            If the name does not exist; the message lists the names.
        """
        if name not in self._by_name:
            raise UnknownNameError.of("value", name, self._by_name)
        return self._by_name[name]

    @property
    def predicted_settling(self) -> float | None:
        """Settling time from the spectrum; None for an unstable point or a misprint."""
        design, form = self.design, self.equations.form
        if design is None or not design.settled or form != form.designable:
            return None
        predicted = design.predicted_settling()
        return predicted if np.isfinite(predicted) else None

    @checked
    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the solution into a folder, completely or not at all.

        The folder contains the problem as text, the network and the designed network as weight
        files (readable by `load`), the trajectory, the status, the certificate and the design.
        `load_solution` reads it.

        Parameters
        ----------
        folder : path-like
            Folder that does not exist yet, in an existing folder.
        overwrite : bool, optional
            True to replace the folder of a saved solution as a whole. Any other existing folder or
            file is never replaced.

        Raises
        ------
        OutputError
            If the folder exists and is not to be replaced, or cannot be written.
        ExpressionError
            If the problem has a function without a text form.

        Examples
        --------
        >>> import tempfile
        >>> from ann_dc import OdeBackend, load_solution, plants, solve
        >>> solution = solve(plants.double_integrator(N=3))
        >>> with tempfile.TemporaryDirectory() as place:
        ...     solution.save(f"{place}/result")
        ...     again = load_solution(f"{place}/result")
        >>> again.verdict, bool((again["a"] == solution["a"]).all())
        ('strict local minimum', True)
        """
        networks = {"network": self.network}
        records: dict[str, object] = {
            "problem": written(self.problem),
            "form": self.equations.form,
            "run": self.run,
            "certificate": self.certificate,
        }
        if self.design is not None:
            networks["design"] = self.design.network
            records["design"] = self.design
        save_result(folder, networks, records, overwrite=overwrite)

    def as_dict(self) -> dict:
        """Return status, figures and values as plain data for JSON."""
        settled, kept = self.status.settled, self.certificate.complementarity
        soft, largest = self.certificate.soft_rows, self.certificate.largest
        fastest = self.normalised_settling_time if settled else None
        return {
            "problem": self.problem.name,
            "form": str(self.equations.form),
            "status": self.status.outcome.name.lower(),
            "message": self.status.message,
            "settled": settled,
            "objective": self.objective,
            "kkt_residual": self.kkt_residual,
            "constraint_residual": self.certificate.constraint_residual,
            "stationarity_residual": self.certificate.stationarity_residual,
            "certified": self.certified,
            **({} if kept is None else {"inequalities": asdict(kept)}),
            **({} if soft is None else {"soft_rows": asdict(soft)}),
            **({} if largest is None else {"objectives": largest.as_dict()}),
            "newton_step": self.certificate.newton_step,
            "second_order": self.certificate.second_order if self.certificate.first_order else None,
            "rollout_error": self.rollout_error,
            "settling_time": self.settling_time if settled else None,
            "normalised_settling_time": fastest,
            "steps": self.run.steps,
            "settling_steps": self.run.settling_steps,
            "settling_verified": self.run.verified,
            "predicted_settling_time": self.predicted_settling,
            "dt": self.step_length,
            "total_time": self.total_time,
            "units": {**self.problem.units, "time": self.problem.time_unit},
            "values": {
                str(s): self[str(s)].tolist()
                for s in (*self.problem.states, *self.problem.controls)
            },
        }

    def __str__(self) -> str:
        lines = [str(self.problem), f"status                 {self.status}", str(self.certificate)]
        if isinstance(self.problem.dt, StepLength):
            lines.append(f"step length            {self.chosen_step}")
        if self.status.settled:
            lines.append(
                f"settling to tolerance  {self.normalised_settling_time:.0f} tau_min (fastest "
                f"time constant) = {self.settling_time:.4g} unit time constants"
            )
        if (predicted := self.predicted_settling) is not None:
            lines.append(f"predicted              {predicted:.4g} unit time constants")
        lines.append(f"certified              {'yes' if self.certified else 'no'}: {self.verdict}")
        return "\n".join(lines)


class _Populations(dict[str, np.ndarray]):
    """Arrays by population; the error for an unknown name lists the populations."""

    def __missing__(self, name: str) -> np.ndarray:
        raise UnknownNameError.of("population", name, self)


def units_of(problem: OptimalControlProblem, network: Network) -> dict[str, str]:
    """Return the units by neuron name, for neurons of the network with units."""
    units = {name: problem.unit(name) for name in network.neuron_index}
    return {name: unit for name, unit in units.items() if unit}


@phase("certificate")
def certificate_of(problem: OptimalControlProblem, network: Network, x: np.ndarray) -> Certificate:
    """Return the certificate of a state (n,), with multipliers m = mu + rho c of its neurons."""
    return certify(problem, *kkt_point(network, x))
