"""The answer in the problem's own names: values, status, settling time, certificate, network."""

from __future__ import annotations

import os
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
from ann_dc.errors import UnknownNameError
from ann_dc.evaluation.populations import kkt_point, neuron_values
from ann_dc.gain_design.procedure import Design
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import Certificate, certify
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.serialisation import written
from ann_dc.problem.step_length import StepLength, mean_length, stage_times
from ann_dc.si_prefixes import lasting
from ann_dc.solution.saved_result import save_result
from ann_dc.timing import phase
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as


@such_as("ann_dc.solve(problem)")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(Record):
    """What a network settled to.

    ``solution["phi"]`` is a state over N + 1 stages, ``solution["nu"]`` a control over N stages,
    ``solution["mu.phi"]`` one neuron over the stages, and ``solution["mu"]`` a whole population
    with one column a component, unless a state or control has that name: it goes first.
    ``solution["z.disc"]`` is the multiplier zeta of the inequality ``disc``, at every stage.
    ``solution.populations["u"]`` is the population whatever the problem's names are. A step length
    that the network chose is there by its symbol, over N stages.

    Attributes
    ----------
    problem : OptimalControlProblem
    equations : StageEquations
        The form that was wired.
    network : Network
        The frozen network that ran.
    run : Run
        Trajectory, status and settling time of the run.
    certificate : Certificate
        Whether what it settled to is an optimum, by the problem alone.
    design : Design or None
        How the gains were found; None when they were given.

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
        """How the run ended."""
        return self.run.status

    @cached_property
    def trajectory(self) -> Trajectory:
        """Neurons over network time, with the problem's units of measure."""
        return self.run.trajectory.measured_in(units_of(self.problem, self.network))

    @property
    def objective(self) -> float:
        """Total cost E in the user's units."""
        return self.certificate.objective

    @property
    def kkt_residual(self) -> float:
        """Relative first-order residual, from the problem's exact derivatives."""
        return self.certificate.kkt_residual

    @property
    def rollout_error(self) -> float:
        """Distance from q_d at which the controls alone arrive."""
        return self.certificate.rollout_error

    @property
    def certified(self) -> bool:
        """True if the answer is an optimum: of a network that settled, or as ``status`` tells."""
        told = (Outcome.SETTLED, Outcome.FOUND, Outcome.STOPPED)
        return self.status.outcome in told and self.certificate.certified

    @property
    def verdict(self) -> str:
        """Why the answer is certified, or why not."""
        if self.status.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED):
            return self.status.outcome.value
        if self.status.settled:
            return self.certificate.reason
        known = f"{self.certificate.reason}, but " if self.certified else ""
        return f"{known}the network did not settle"

    @cached_property
    def time(self) -> np.ndarray:
        """(N+1,): when every stage begins, and the last one ends, in the unit of dt."""
        return stage_times(self.problem.dt, self.populations["q"].T)

    @property
    def step_length(self) -> float:
        """Length of a stage: dt, or what the network chose, the mean where it did not settle."""
        return mean_length(self.problem.dt, self.populations["q"].T)

    @property
    def total_time(self) -> float:
        """N times the step length."""
        return float(self.time[-1])

    @property
    def chosen_step(self) -> str:
        """The step length and the total time in words; at which bound, where it lies at one."""
        problem, dt = self.problem, self.problem.dt
        length, total = (problem.timed(f"{v:.6g}") for v in (self.step_length, self.total_time))
        bound = dt.bound_at(self.step_length) if isinstance(dt, StepLength) else ""
        at = f" (its {bound} bound)" if bound else ""
        return f"{length}{at}, {lasting(problem.horizon)} {total}"

    @property
    def settling_time(self) -> float:
        """Network time after which the KKT residual stays below tolerance; nan if it never does."""
        return self.run.settling_time

    @cached_property
    def spectrum(self) -> Spectrum:
        """Eigenvalues of the frozen network where it ended."""
        return spectrum(self.network, self.trajectory.final)

    @property
    def settling_in_fastest_time_constants(self) -> float:
        """Settling time times the spectral radius: what hardware of a given speed needs."""
        return self.settling_time * self.spectrum.radius if self.status.settled else float("nan")

    @cached_property
    def populations(self) -> Mapping[str, np.ndarray]:
        """q (N+1, n), u (N, m), t, mu and beta (N, n) in the user's units; for reading only.

        And z (N, rows), where there are inequalities; z_end (N, rows) counts in the last stage.
        Unlike ``solution[name]``, where a state or control called ``u`` goes first, a name here is
        always that of a population.

        Raises
        ------
        UnknownNameError
            When it is asked for a name that is no population; the message lists them.
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
        """Values over the stages, by the name of a state, control, population or neuron.

        A state or control goes before a population of its name (`populations` has those).

        Raises
        ------
        UnknownNameError
            If there is no such name; the message lists what there is.
        """
        if name not in self._by_name:
            raise UnknownNameError.of("value", name, self._by_name)
        return self._by_name[name]

    @property
    def predicted_settling(self) -> float | None:
        """Settling time from the spectrum; None without a point that attracts, or of a misprint."""
        design, form = self.design, self.equations.form
        if design is None or not design.settled or form != form.designable:
            return None
        predicted = design.predicted_settling()
        return predicted if np.isfinite(predicted) else None

    @checked
    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write everything into a new folder, all of it or nothing; `load_solution` reads it.

        It holds the problem as text, the network and the designed one as weight files (`load`
        reads them), the trajectory, how the run ended, the certificate and the design.

        Parameters
        ----------
        folder : path-like
            That does not exist yet, in a folder that does.

        Raises
        ------
        OutputError
            If the folder exists or cannot be written.
        ExpressionError
            If the problem has a function that text cannot say.

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
        save_result(folder, networks, records)

    def as_dict(self) -> dict:
        """Plain data for JSON: status, figures and values."""
        settled, kept = self.status.settled, self.certificate.complementarity
        soft, largest = self.certificate.soft_rows, self.certificate.largest
        fastest = self.settling_in_fastest_time_constants if settled else None
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
            "settling_in_fastest_time_constants": fastest,
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
                f"settling to tolerance  {self.settling_in_fastest_time_constants:.0f} fastest "
                f"time constants = {self.settling_time:.4g} unit time constants"
            )
        if (predicted := self.predicted_settling) is not None:
            lines.append(f"predicted              {predicted:.4g} unit time constants")
        lines.append(f"certified              {'yes' if self.certified else 'no'}: {self.verdict}")
        return "\n".join(lines)


class _Populations(dict[str, np.ndarray]):
    """Arrays by population; an unknown name is answered with those that exist."""

    def __missing__(self, name: str) -> np.ndarray:
        raise UnknownNameError.of("population", name, self)


def units_of(problem: OptimalControlProblem, network: Network) -> dict[str, str]:
    """Units of measure by the neuron's name, of those that have one.

    Parameters
    ----------
    problem : OptimalControlProblem
    network : Network
        Synthesized from it.

    Returns
    -------
    dict of str to str
    """
    units = {name: problem.unit(name) for name in network.neuron_index}
    return {name: unit for name, unit in units.items() if unit}


@phase("certificate")
def certificate_of(problem: OptimalControlProblem, network: Network, x: np.ndarray) -> Certificate:
    """Certificate of a state vector of a problem's network.

    The multipliers are those that the network works with: the outputs m = mu + rho c of its duals.

    Parameters
    ----------
    problem : OptimalControlProblem
    network : Network
        Synthesized from it.
    x : (n,) array
        State vector.

    Returns
    -------
    Certificate
    """
    return certify(problem, *kkt_point(network, x))
