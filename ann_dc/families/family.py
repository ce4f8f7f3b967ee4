"""Operating range: inputs of one network as ranges, as a list, or as a sampler.

Inputs are those of the network's cell: components of q_0 and q_d, and further inputs that the
problem declares. An operating range yields a list of samples. A sample is a value for every input.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ann_dc.errors import ProblemError, UnknownNameError
from ann_dc.network.inputs import drawn_values, input_batch, moved_starts
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import Own, checked

Sample = dict[str, np.ndarray]
"""Value (N,) of every input of the operating range, in the user's units."""

Over = (
    Mapping[str, tuple[float, float]]
    | Sequence[Mapping[str, Any]]
    | Callable[[np.random.Generator, int], Sequence[Mapping[str, Any]]]
)
"""Operating range: ranges by input name, a list of samples, or a function (generator, count) that
draws samples.
"""

BOUNDING = 1000
"""Number of samples from which the ranges of a sampler are determined."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Family:
    """Inputs for which one network is designed; see `family_of`.

    The samples replace the inputs of the network. `ranges` contains the lowest and highest value of
    every input, declared or observed.
    """

    problem: OptimalControlProblem
    network: Network
    operating_range: Over
    ranges: Mapping[str, tuple[float, float]]

    def samples(self, count: int, *, seed: int) -> list[Sample]:
        """Return samples that fill the ranges or come from the sampler, or the list.

        The same seed gives the same samples on any machine.
        """
        return _drawn(self.network, self.operating_range, count, seed)

    def held_out(self, count: int, *, seed: int) -> list[Sample]:
        """Draw independent samples, so that fractions have an interval; or the list."""
        return _drawn(self.network, self.operating_range, count, seed, independent=True)

    @property
    def is_listed(self) -> bool:
        """True if the declared samples are the only samples."""
        return not callable(self.operating_range) and not isinstance(self.operating_range, Mapping)

    def network_of(self, sample: Sample) -> Network:
        """Return the network with a sample's inputs and the sample's straight-line start."""
        batch = input_batch(self.network, {name: value[None] for name, value in sample.items()})
        start = moved_starts(self.network, batch)[0]
        return self.network.with_inputs(sample).with_start(start)

    def problem_of(self, sample: Sample) -> OptimalControlProblem:
        """Return the problem with a sample's inputs."""
        return problem_at(self.problem, sample)


def problem_at(problem: OptimalControlProblem, inputs: Mapping[str, Any]) -> OptimalControlProblem:
    """Return the problem with other inputs of its network, such as ``q_d.x``.

    Of values (N,) of a boundary condition, the first counts for q_0 and the last for q_d.
    """
    if not inputs:
        return problem
    states = [str(state) for state in problem.states]
    ends: dict[str, list] = {"q_0": [*problem.q_0], "q_d": [*(problem.q_d or ())]}
    further: dict[str, Any] = {}
    for name, value in inputs.items():
        end, _, component = name.partition(".")
        if end in ends and component in states:
            ends[end][states.index(component)] = float(np.ravel(value)[0 if end == "q_0" else -1])
        else:
            further[name] = value
    return problem.with_inputs(**ends, **further)


@checked
def family_of(
    problem: OptimalControlProblem, network: Network, over: Annotated[Over, Own()]
) -> Family:
    """Return the operating range that a user declares.

    `over` has one of three forms. Ranges {"q_d.x": (3, 7)} are sampled independently for all values
    of all inputs. A list contains samples [{"q_d.x": 3}, ...]. A function (generator, count)
    returns such a list.

    Raises `ProblemError` if a range is empty or not finite, or if a sample has a value that is not
    a number. Raises `UnknownNameError`, with the inputs of the network, for an unknown input.

    >>> from ann_dc import plants, synthesize
    >>> problem = plants.double_integrator(N=5)
    >>> family = family_of(problem, synthesize(problem), {"q_d.x": (0.5, 2.0)})
    >>> [bool(0.5 <= sample["q_d.x"][0] <= 2.0) for sample in family.samples(3, seed=0)]
    [True, True, True]
    """
    if isinstance(over, Mapping):
        ranges = _checked_ranges(network, over)
        return Family(problem=problem, network=network, operating_range=over, ranges=ranges)
    is_list = isinstance(over, Sequence) and not isinstance(over, (str, bytes)) and len(over) > 0
    if isinstance(over, type) or not (callable(over) or is_list):
        raise ProblemError(
            f"ranges: expected {{'q_d.x': (3, 7)}}, a list of samples [{{'q_d.x': 3}}], or a "
            f"function (generator, count) that returns one; got {over!r}"
        )
    met = _drawn(network, over, BOUNDING, 0)
    ranges = {
        name: (min(s[name].min() for s in met), max(s[name].max() for s in met)) for name in met[0]
    }
    return Family(problem=problem, network=network, operating_range=over, ranges=ranges)


def _checked_ranges(network: Network, ranges: Mapping) -> dict[str, tuple[float, float]]:
    if not ranges:
        raise ProblemError(
            "ranges: expected one input or more, got none; inputs are "
            f"{', '.join(network.cell.inputs)}"
        )
    return {name: _checked_range(network, name, given) for name, given in ranges.items()}


def _checked_range(network: Network, name: str, given: Any) -> tuple[float, float]:
    if name not in network.cell.inputs:
        raise UnknownNameError.of("ranges: input", str(name), network.cell.inputs)
    try:
        low, high = (float(end) for end in given)
    except (TypeError, ValueError) as error:
        raise ProblemError(
            f"ranges[{name}]: expected its lowest and highest value, (low, high), got {given!r}"
        ) from error
    if not (np.isfinite([low, high]).all() and low < high):
        raise ProblemError(
            f"ranges[{name}]: the range from {low:g} to {high:g} is empty or not finite; use "
            "(low, high) with low < high, and omit constant inputs"
        )
    return low, high


def _drawn(
    network: Network, over: Over, count: int, seed: int, *, independent: bool = False
) -> list[Sample]:
    if isinstance(over, Mapping):
        values = drawn_values(over, count, seed, independent=independent)
        ones = np.ones(network.stages)
        return [{name: value * ones for name, value in zip(over, row)} for row in values]
    given = over(np.random.default_rng(seed), count) if callable(over) else over
    return _checked_samples(network, given)


def _checked_samples(network: Network, given: Iterable[Mapping[str, Any]]) -> list[Sample]:
    samples = []
    for number, sample in enumerate(given):
        if not isinstance(sample, Mapping):
            raise ProblemError(
                f"ranges[{number}]: expected a sample such as {{'q_d.x': 3}}, got {sample!r}"
            )
        values: Sample = {}
        for name, value in sample.items():
            if name not in network.cell.inputs:
                raise UnknownNameError.of(f"ranges[{number}]: input", name, network.cell.inputs)
            try:
                values[name] = np.broadcast_to(np.asarray(value, float), network.stages)
            except (TypeError, ValueError) as error:
                raise ProblemError(
                    f"ranges[{number}][{name}]: expected one number or {network.stages} of them, "
                    f"got {value!r}"
                ) from error
            if not np.isfinite(values[name]).all():
                raise ProblemError(f"ranges[{number}][{name}]: {value!r} is not finite")
        samples.append(values)
    if len({frozenset(sample) for sample in samples}) != 1:
        raise ProblemError("ranges: expected the same inputs in every sample, at least one")
    return samples
