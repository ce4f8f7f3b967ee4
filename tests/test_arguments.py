"""Every argument of every public function and record, given what it cannot be.

The calls are generated from the signatures: one valid call of each, then each of its arguments in
turn as another type, another shape, nan, and nothing. What comes back is an error of ours, before
anything runs.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from public_face import arguments, callables, default_of

import ann_dc
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.errors import AnnDcError, ArgumentError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.fidelity.level_comparison import Group, Measured

FACE = callables()

INNER = {
    "AdaptiveStep.lengths", "FixedStep.lengths",
    "CellLayer.fill", "CellLayer.flow_of", "CellLayer.pack", "CellLayer.set_extra_state",
    "CellLayer.states_of",
    "two_level.Closed.solve", "two_level.Iterated.solve", "two_level.Gradient.move",
    "two_level.NewtonCoordinator.move", "two_level.OracleCoordinator.move",
    "two_level.Distances", "two_level.Lyapunov", "two_level.lyapunov_of", "two_level.printed_of",
    "two_level.OracleGain.of", "two_level.PrintedMatrices.of", "two_level.StageHessians.of",
    "Scale.network", "Scale.user", "StepLength.length", "StepLength.bound_at",
    "Soft.cost", "OptimalControlProblem.timed", "OptimalControlProblem.functions_with",
    "OptimalControlProblem.objective_stages", "OptimalControlProblem.objective_values",
    "OptimalControlProblem.shared_by",
}  # fmt: skip
"""What a run asks for itself, or what writes a word of a figure: no user calls it."""

JUNK = {
    "an object": object(),
    "text": "nonsense",
    "no text": "",
    "bytes": b"\0",
    "complex": 1j,
    "nan": float("nan"),
    "None": None,
    "a class": dict,
    "nothing": (),
    "an empty list": [],
    "an empty mapping": {},
    "an empty array": np.array([]),
    "another shape": np.zeros((2, 3, 4, 5)),
    "an array of nan": np.full(3, np.nan),
    "an array of objects": np.array([object()]),
    "a list of objects": [object()],
    "a mapping of objects": {"x": object()},
}

LEGITIMATE = (
    ("any text names or captions something", {"text", "no text"},
     "Network.title OptimalControlProblem.name Study.title "
     "StepLength.symbol levels.Level.name plotting.caption.form "
     "plotting.headline.words plotting.with_unit.name plotting.with_unit.unit "
     "two_level.Coordination.coordinator two_level.Coordination.lower"),
    ("any text is a path", {"text"},
     "Solution.save.folder Study.run.folder save.path export_network.out plotting.save.path "
     "plotting.save_all.folder"),
    ("no text is the folder that one is in", {"no text"},
     "Study.run.folder export_network.out plotting.save_all.folder"),
    ("what is not named stays as it is", {"an empty mapping"},
     "CellLayer.flow.inputs CellLayer.forward.inputs CellLayer.starts.inputs "
     "RecurrentLayer.equilibrium.inputs RecurrentLayer.forward.inputs RecurrentLayer.settle.inputs "
     "RecurrentBackend.run_batch.inputs OdeBackend.run_batch.inputs "
     "TwoLevels.step.inputs TwoLevels.run.inputs "
     "Network.with_inputs.values SpiceBackend.deck.deviations emulate.deviations "
     "nonidealities.leak.unit nonidealities.saturation.limit manual_gains.rho manual_gains.tau"),
    ("there may be none", {"nothing", "an empty list", "an empty mapping"},
     "Network.fixed Network.omitted OptimalControlProblem.constraints "
     "OptimalControlProblem.terminal_constraints Multistart.optima Multistart.others "
     "OptimalControlProblem.objectives OptimalControlProblem.weights "
     "two_level.Coordination.values StageEquations.rows StageEquations.end_rows"),
    ("of no rows there are no multipliers", {"nothing", "an empty list", "an empty array"},
     "certify.zeta_end"),
    ("None says that there is none", {"None"},
     "Solution.design two_level.Coordination.gains two_level.TwoLevelRun.distances "
     + " ".join(f"{plant}.q_d" for plant in FACE
                if plant.startswith("plants.") and plant != "plants.get")),
)  # fmt: skip
"""Values of the list above that some arguments may have, and why."""


@cache
def problem():
    return ann_dc.plants.double_integrator(N=3)


@cache
def design():
    return ann_dc.design(problem(), preconditioner=ann_dc.PreconditionerKind.DIAGONAL)


@cache
def solution():
    return ann_dc.solve(problem(), preconditioner=ann_dc.PreconditionerKind.DIAGONAL)


@cache
def family():
    return ann_dc.design(problem(), ranges=[{"q_d.x": 0.5}, {"q_d.x": 1.0}])


@cache
def found():
    return ann_dc.multistart(problem(), 2)


@cache
def competing():
    return replace(problem(), cost=0, objectives=(problem().cost, problem().states[0] ** 2))


@cache
def front():
    return ann_dc.pareto(competing(), 1)


@cache
def prepared():
    return ann_dc.SpiceBackend().prepare(design().network)


@cache
def coordination():
    return ann_dc.two_level.coordinate(problem())


def fields(record) -> dict:
    return {name: getattr(record, name) for name in arguments(type(record))}


def settled():
    return solution().run.trajectory.final


def point():
    return kkt_point(design().network, settled())


def oracle():
    return ann_dc.two_level.OracleGain(settled=settled())


def circuit():
    return {"circuit": prepared()[0]}


def emulation():
    return ann_dc.emulate(prepared()[0], ann_dc.levels.macro())


@cache
def deck():
    return ann_dc.SpiceBackend().deck(*prepared(), {})


def circuit_run():
    circuit, probe = prepared()
    return CircuitRun(trajectory=probe, deck=deck(), overloads=(), probe=probe, circuit=circuit)


def layer():
    return ann_dc.CellLayer(design().network)


def figure():
    return ann_dc.plotting.new_figure(3.0, 2.0)


@cache
def closed_network():
    """Whose first state is a neuron, as the two-level algorithm wants it."""
    return ann_dc.synthesize(ann_dc.decompose(problem(), ann_dc.Form(start_is_neuron=True)))


def upper_map():
    network = closed_network()
    rest = ann_dc.equilibrium(network, network.start_state)
    return ann_dc.UpperMap(network=network, settled=rest)


@cache
def study():
    return ann_dc.Study(subject=problem(), metrics=["settling_time"])


class Spy:
    """A backend that must not be asked to run."""

    kinds = (ann_dc.PreconditionerKind.DIAGONAL,)

    def run(self, network):
        return solution().run


RECORDS = {
    "FamilyDesign": family, "Multistart": found, "Solution": solution,
    "Network": lambda: design().network,
    "StageEquations": lambda: solution().equations, "OptimalControlProblem": problem,
    "Gains": lambda: design().gains,
    "InitialGuess": lambda: ann_dc.interpolated_guess(problem()),
    "levels.Level": lambda: ann_dc.levels.BEHAVIOURAL,
    "ode.Method": lambda: ann_dc.ode.RK45, "two_level.Coordination": coordination,
    "two_level.Following": lambda: coordination().following,
    "two_level.Hypothesis": lambda: coordination().hypothesis,
    "two_level.TwoLevelRun": lambda: coordination().run,
    "two_level.UpperGains": lambda: coordination().gains,
    "two_level.OracleGain": lambda: ann_dc.two_level.OracleGain(settled=settled()),
    "Study": study, "UpperMap": upper_map,
}  # fmt: skip
"""Records, by how one of each is come by: its fields are a valid call."""

OWNERS = {
    "CellLayer": layer,
    "Multistart": found,
    "Network": lambda: design().network,
    "OdeBackend": ann_dc.OdeBackend,
    "OptimalControlProblem": problem,
    "RecurrentBackend": lambda: ann_dc.RecurrentBackend(limit=5),
    "Solution": solution,
    "RecurrentLayer": lambda: ann_dc.RecurrentLayer(design().network),
    "SpiceBackend": ann_dc.SpiceBackend,
    "Study": study,
    "TwoLevels": lambda: ann_dc.TwoLevels(
        design().network, upper=ann_dc.two_level.NewtonCoordinator()
    ),
    "UpperMap": upper_map,
    "Waveform": lambda: ann_dc.Waveform(times=np.array([0.0, 1.0]), values=np.array([1.0, 2.0])),
    "levels.Level": ann_dc.levels.macro,
    "ode.Method": lambda: ann_dc.ode.RK45,
    "two_level.Closed": ann_dc.two_level.Closed,
    "two_level.Iterated": ann_dc.two_level.Iterated,
    "two_level.OracleBackend": lambda: ann_dc.two_level.OracleBackend(gain=oracle()),
    "two_level.OracleGain": oracle,
    "two_level.TwoLevelRun": lambda: coordination().run,
    "two_level.UpperGains": lambda: coordination().gains,
}
"""Whose method is called."""

GIVEN: dict[str, Callable[[], dict]] = {
    "Multistart.solution": lambda: {"index": 0},
    "Network.at_time": lambda: {"time": 1.0},
    "Waveform": lambda: {"times": np.array([0.0, 1.0]), "values": np.array([1.0, 2.0])},
    "Waveform.at": lambda: {"time": 0.5},
    "Network.input_scale": lambda: {"name": "q_d.x"},
    "Network.label": lambda: {"component": 0},
    "Network.neuron": lambda: {"name": "q.x"},
    "Network.pack": lambda: {"values": np.zeros(design().network.live.shape)},
    "Network.with_inputs": lambda: {"values": {"q_d.x": 2.0}},
    "OptimalControlProblem.unit": lambda: {"name": "x"},
    "OptimalControlProblem.with_horizon": lambda: {"horizon": 4},
    "RecurrentBackend.run_batch": lambda: {"inputs": {"q_d.x": [0.5, 1.0]}},
    "OdeBackend.run_batch": lambda: {"inputs": {"q_d.x": [0.5, 1.0]}},
    "RecurrentLayer.forward": lambda: {"x": None, "steps": 2},
    "RecurrentLayer.settle": lambda: {"x": None, "limit": 5},
    "RecurrentLayer.equilibrium": lambda: {"x": None},
    "AdaptiveStep": lambda: {"progress": 0.9},
    "CellLayer.forward": lambda: {"x": torch.as_tensor(settled())[None], "step": 0.1},
    "Solution.save": lambda: {"folder": "saved"},
    "StepLength": lambda: {"low": 0.1},
    "Soft": lambda: {"weight": 30.0},
    "SpiceBackend.check_stable": lambda: {"emulation": emulation(), "probe": prepared()[1]},
    "SpiceBackend.deck": lambda: {**circuit(), "probe": prepared()[1], "deviations": {}},
    "SpiceBackend.deviations": circuit,
    "SpiceBackend.measure": lambda: {**circuit(), "deck": deck(), "probe": prepared()[1]},
    "Study.row": lambda: {"point": 0},
    "Study.run": lambda: {"workers": 0},
    "TwoLevels": lambda: {"upper": ann_dc.two_level.NewtonCoordinator()},
    "TwoLevels.step": lambda: {"x": settled()},
    "TwoLevels.run": lambda: {"x": None, "settled": None, "limit": 2},
    "UpperMap.radius": lambda: {"lambda_t": 0.1, "lambda_beta": 0.1},
    "FixedStep": lambda: {"step": 0.1},
    "diagnose": lambda: {"source": design()},
    "apply_gains": lambda: {"gains": design().gains},
    "certify": lambda: dict(zip(("q", "u", "t", "mu", "beta"), point())),
    "nonidealities.detuned": lambda: {"relative": 0.1, "seed": 0},
    "nonidealities.drawn_numbers": lambda: {"seeds": [0, 1]},
    "nonidealities.extra_pole": lambda: {"bandwidth": 10.0},
    "nonidealities.gain_error": lambda: {"relative": 0.1},
    "nonidealities.leak": lambda: {"gain": 100.0},
    "nonidealities.mismatch": lambda: {"relative": 0.1, "seed": 0},
    "nonidealities.noise": lambda: {"density": 1e-6},
    "nonidealities.offset": lambda: {"size": 0.1},
    "nonidealities.saturation": lambda: {"limit": 5.0},
    "nonidealities.slew": lambda: {"rate": 5.0},
    "emulate": lambda: {**circuit(), "level": ann_dc.levels.macro()},
    "levels.Level.at": lambda: {"conditions": ann_dc.hardware.parts.Conditions(supply=0.9)},
    "levels.switched_capacitor": lambda: {"step": 0.1},
    "load": lambda: {"path": "network.npz"},
    "export_network": lambda: {"network": design().network, "to": "conductances", "out": "out"},
    "inspect_export": lambda: {"path": "network.npz"},
    "load_solution": lambda: {"folder": "saved"},
    "load_study": lambda: {"path": "study.toml"},
    "load_table": lambda: {"folder": "out"},
    "load_problem": lambda: {"path": "problem.toml"},
    "multistart": lambda: {"starts": 2, "preconditioner": [ann_dc.PreconditionerKind.DIAGONAL]},
    "pareto": lambda: {"problem": competing(), "points": 1},
    "plants.get": lambda: {"name": "car"},
    "plotting.circuit": lambda: {"run": circuit_run()},
    "plotting.diagnosis": lambda: {"found": ann_dc.diagnose(design())},
    "plotting.family": lambda: {"designed": family()},
    "plotting.front": lambda: {"found": front()},
    "plotting.headline": lambda: {"figure": figure(), "words": "words"},
    "plotting.comparison": lambda: {"done": [Measured(name="ODE", group=Group.DIGITAL)]},
    "plotting.convergence": lambda: {"runs": {"solve": solution().run}},
    "plotting.new_figure": lambda: {"width": 3.0, "height": 2.0},
    "plotting.quiet": lambda: {"axes": figure().subplots()},
    "plotting.save": lambda: {"figure": figure(), "path": "figure.png"},
    "plotting.save_all": lambda: {"folder": "figures"},
    "plotting.with_unit": lambda: {"name": "x", "unit": "m"},
    "presets.get": lambda: {"name": "opa192_ad734"},
    "random_guess": lambda: {"rng": 0},
    "report.write_study_page": lambda: {"study": "out", "path": "page.html"},
    "save": lambda: {"path": "network.npz"},
    "solve": lambda: {"backend": Spy(), "gains": design().gains},
    "design": lambda: {"preconditioner": [ann_dc.PreconditionerKind.DIAGONAL]},
    "switch": lambda: {"name": "S3"},
    "two_level.Gradient": lambda: {"lambda_t": 0.1, "lambda_beta": 0.1},
    "two_level.OracleBackend": lambda: {"gain": oracle()},
    "two_level.OracleCoordinator": lambda: {"gain": oracle()},
    "two_level.TwoLevelRun.message": lambda: {"sample": 0},
    "two_level.Undesigned": lambda: {"steps": 3},
    "two_level.best_gradient": lambda: fields(upper_map()),
    "two_level.Closed.check": lambda: {"network": closed_network()},
    "two_level.Iterated.check": lambda: {"network": closed_network()},
    "two_level.UpperGains.predicted": lambda: {"tolerance": 1e-6},
    "two_level.coordinate": lambda: {"limit": 5},
}
"""What a call cannot do without, beside a network, a problem, a state and a solution."""


def base(name: str) -> tuple:
    """One valid call: what is called, and its arguments."""
    thing = FACE[name]
    owner, _, method = name.rpartition(".")
    network = design().network
    every = {
        "network": network, "problem": problem(), "x": settled(), "settled": settled(),
        "solution": solution(), "progress": print, "source": problem(),
    }  # fmt: skip
    own = {name: value for name, value in every.items() if name in arguments(thing)}
    made = RECORDS.get(name)
    if made is not None:
        return thing, fields(made())
    if owner in OWNERS:
        thing = getattr(OWNERS[owner](), method)
    return thing, {**own, **GIVEN.get(name, lambda: {})()}


def same(value, default) -> bool:
    if value is None or default is None:
        return value is default
    return type(value) is type(default) and bool(np.array_equal(value, default))


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def may_be(name: str, argument: str) -> set[str]:
    """What else an argument takes, by the table."""
    place = f"{name}.{argument}"
    return {word for _, words, places in LEGITIMATE if place in places.split() for word in words}


CHECKED = sorted(set(FACE) - INNER)


@pytest.mark.parametrize("name", CHECKED)
def test_no_argument_is_nonsense(name, monkeypatch):
    reported = []
    thing, given = base(name)
    monkeypatch.setattr(Recorder, "record", lambda *_: reported.append("a run began"))
    if "progress" in given and name != "AdaptiveStep":
        given["progress"] = reported.append
    wrong = []
    for argument in arguments(FACE[name]):
        default, legitimate = default_of(FACE[name], argument), may_be(name, argument)
        for word, junk in JUNK.items():
            if word in legitimate or same(junk, default):
                continue
            try:
                thing(**{**given, argument: junk})
                wrong.append(f"{argument}: {word} was taken")
            except AnnDcError as error:
                message = str(error)  # of shapes that contradict each other, either may be named
                named = message.startswith(argument) or "expected an array of shape" in message
                if isinstance(error, ArgumentError) and not named:
                    wrong.append(f"{argument}: {word}: {error}")
            except Exception as error:
                wrong.append(f"{argument}: {word}: {error!r}")
    assert wrong == []
    assert reported == []


LONG = {
    "SpiceBackend.run", "SpiceBackend.measure", "two_level.OracleBackend.run",
    "plotting.save_all", "plotting.diagnosis", "multistart", "Multistart.solution", "load",
    "inspect_export", "load_problem", "load_solution", "load_study", "load_table",
    "RecurrentLayer.equilibrium", "report.write_study_page", "two_level.coordinate",
}  # fmt: skip
"""Whose valid call takes seconds, a simulator, or a file."""


@pytest.mark.parametrize("name", sorted(set(CHECKED) - LONG))
@pytest.mark.sampled
def test_the_valid_call_is_valid(name):
    thing, given = base(name)
    thing(**given)


def test_every_exception_is_one():
    """Nothing is called legitimate that is not there any more."""
    for _, words, places in LEGITIMATE:
        assert words <= set(JUNK)
        for place in places.split():
            name, _, argument = place.rpartition(".")
            assert argument in arguments(FACE[name]), place
    assert set(FACE) >= INNER | LONG
