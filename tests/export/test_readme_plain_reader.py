"""Networks read by NumPy and the README alone: the steps of the reference vector, on every kind."""

import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from clamped_runs import OF_RUNS, run_with_changes, with_limits
from constrained import CONSTRAINED, integrator
from designs import coordinated, designed, wired_with
from minimax import CASES, car
from random_networks import far_wired, random_network

import ann_dc
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.readme import reader
from ann_dc.export.reference.vector import EulerWalk, ReferenceVector
from ann_dc.export.weight_files import weights_files
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.scale import Scale
from ann_dc.solver import synthesize
from ann_dc.weights.hashes import content_hash, wiring_hash

EARLY = (1, 50)
PRECONDITIONER = ("gain", "grid", "tree")


def soft_rows():
    return synthesize(integrator(N=8, dt=0.1, bounds={sp.Symbol("v"): (None, 0.9)}, soft=5))


def scaled_inputs():
    network = random_network(3)
    scales = {name: Scale(2.0, -0.5) for name in network.cell.inputs}
    return replace(network, input_scales=scales)


NETWORKS = {
    "far wires": lambda: far_wired(3),
    **{
        f"arm, {kind.value}": lambda kind=kind: wired_with("two_link_arm", kind)
        for kind in PreconditionerKind
    },
    **{
        f"random, {kind.value}": lambda kind=kind: random_network(7, kind)
        for kind in PreconditionerKind
    },
    **{f"random {seed}": lambda seed=seed: random_network(seed) for seed in range(4)},
    "scaled inputs": scaled_inputs,
    "inequalities": lambda: synthesize(CONSTRAINED["lander"].problem),
    "rails": lambda: synthesize(CONSTRAINED["dint_u"].problem),
    "soft rows": soft_rows,
    "minimax": lambda: synthesize(car(CASES["two by range"][0])),
    "minimax with a temperature": lambda: synthesize(
        car(CASES["two by range"][0], temperature=0.1)
    ),
    "free step length": lambda: synthesize(ann_dc.plants.pendulum_free_time()),
    "free end": lambda: designed("cstr").network,
}


def inverse_functions():
    x, a = sp.symbols("x a")
    return synthesize(
        ann_dc.OptimalControlProblem(
            states=(x,), controls=(a,), dynamics=(sp.atan(x) + sp.asin(x / 4) + a,), dt=0.1,
            cost=a**2 + sp.acos(x / 4) ** 2, horizon=4, q_0=(0.2,), q_d=(1,),
        )
    )  # fmt: skip


NETWORKS["inverse functions"] = inverse_functions


def steps_of(network, step=0.02):
    """A vector of a few steps, wherever they lead."""
    walker, start = EulerWalk(network, step), network.start_state
    states = {count: network.unpack(walker.after(start, count)) for count in EARLY}
    return ReferenceVector(
        wiring=wiring_hash(network), content=content_hash(network), step=step, tolerance=1e-6,
        inputs=dict(network.input_values), start=network.unpack(start), early=states, steps=-1,
        end=states[50], residual=1.0,
    )  # fmt: skip


def printed(folder, program):
    """What it prints with NumPy alone: the largest difference by the number of steps."""
    alone = "import sys; sys.modules['ann_dc'] = sys.modules['safetensors'] = None\n"
    alone += "import numpy; [vars(numpy).pop(n, None) for n in ('atan', 'asin', 'acos')]  # 1.26\n"
    (folder / "reader.py").write_text(alone + program)
    run = subprocess.run(
        [sys.executable, "-I", "reader.py"], cwd=folder, capture_output=True, text=True, check=True
    )
    return {int(k): float(off) for k, off in map(str.split, run.stdout.splitlines())}


def differences(folder, network, form="safetensors"):
    """The same of an export, relative to the largest state or one."""
    vector = steps_of(network)
    for name, content in weights_files(network, vector, form=form).items():
        (folder / name).write_bytes(content)
    reported = printed(folder, reader(f"network.{form}"))
    return {k: off / max(1.0, np.abs(vector.early[k]).max()) for k, off in reported.items()}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", NETWORKS)
def test_reader_of_the_readme_takes_the_steps_of_the_vector(name, tmp_path):
    off = differences(tmp_path, NETWORKS[name]())
    assert off.keys() == set(EARLY)
    assert max(off.values()) < 1e-12


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:unclosed file")
@pytest.mark.parametrize("kind", OF_RUNS, ids=lambda kind: kind.name.lower())
def test_reader_follows_the_rule_of_rails_where_the_held_set_changes_a_hundred_times(
    kind, tmp_path, monkeypatch
):
    network, states, changes = run_with_changes(kind)
    assert changes >= 100
    for name, content in weights_files(network, steps_of(network)).items():
        (tmp_path / name).write_bytes(content)
    monkeypatch.setattr(sys, "argv", ["reader.py", str(tmp_path)])
    names: dict = {}
    exec(reader("network.safetensors").partition("v = json.load")[0], names)
    for x in states:
        expected = evaluator(network).rhs(x)
        found = network.pack(names["moves"](names["state"](network.unpack(x))))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("kind", "is_clamped"),
    [
        (PreconditionerKind.RESISTIVE_GRID, True),
        (PreconditionerKind.MULTILEVEL, False),
        (PreconditionerKind.DIAGONAL, False),
    ],
    ids=["grid", "pyramid", "time constants"],
)
def test_texts_of_an_export_tell_the_rule_of_rails_of_coupled_controls(kind, is_clamped, tmp_path):
    network = with_limits(wired_with("double_integrator", kind), 0.5, "u")
    [done] = ann_dc.export_network(network, "weights", tmp_path)
    text = (done.folder / "README.md").read_text()
    [program] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    about = json.loads((done.folder / "manifest.json").read_text())["about"]
    for reported in ("projected" in program, "v = M (d + r)" in about):
        assert reported == is_clamped
    assert max(printed(done.folder, program).values()) < 1e-12


def test_reader_of_an_npz_takes_the_steps_of_the_vector(tmp_path):
    assert (
        max(differences(tmp_path, wired_with("car", PreconditionerKind.MULTILEVEL), "npz").values())
        < 1e-12
    )


def test_program_in_the_readme_of_an_export_walks_to_the_end(tmp_path):
    [done] = ann_dc.export_network(coordinated("double_integrator"), "weights", tmp_path)
    text = (done.folder / "README.md").read_text()
    [program] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(program.splitlines()) <= 60
    off = printed(done.folder, program)
    assert off.keys() > set(EARLY)
    assert max(off.values()) < 1e-12


@pytest.mark.parametrize("kind", PreconditionerKind)
def test_manifest_defines_the_preconditioner_with_the_arrays_that_it_has(kind):
    network = random_network(7, kind)
    files = weights_files(network, steps_of(network))
    manifest = json.loads(files["manifest.json"])
    arrays = {
        n.replace("/0", "/l") for n in manifest["tensors"] if n.split("/")[0] in PRECONDITIONER
    }
    assert "`one` is the constant 1" in manifest["about"]
    assert "M = diag(1 / tau)" in manifest["about"]
    assert all(f"`{name}`" in manifest["about"] for name in arrays if not name[-1].isdigit())
