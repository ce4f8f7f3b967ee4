"""Torch is for gradients, training and GPUs: everything else runs without it."""

import subprocess
import sys

import pytest

SOLVES = """
import sys
{first}
import ann_dc
from ann_dc.backends.step_rules import ORDERS

problem = ann_dc.plants.double_integrator(N=5)
for order in ORDERS.values():
    for step in (None, ann_dc.FixedStep(step=0.05)):
        backend = ann_dc.RecurrentBackend(order=order, step=step)
        solution = ann_dc.solve(problem, backend=backend)
        assert solution.certified, (order, step)
        batch = backend.run_batch(solution.network, {{"q_d.x": [0.5, 1.0]}})
        assert batch.settled.all(), (order, step)
"""
COMMAND = """
import sys
{first}
from ann_dc.cli.commands.app import app

app(["solve", "car", "--backend", "recurrent", "--quiet"], standalone_mode=False)
"""
TWO_LEVELS = """
import sys
{first}
from ann_dc.cli.commands.app import app

app(["coordinate", "double_integrator", "-N", "5", "--quiet"], standalone_mode=False)
"""
BLOCKED = "sys.modules['torch'] = None"
LOADED = "print(sys.modules.get('torch') is not None)"


def told_by(script: str) -> str:
    """What a fresh interpreter prints."""
    command = [sys.executable, "-W", "ignore", "-c", script]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize(
    "script",
    [SOLVES, pytest.param(COMMAND, marks=pytest.mark.slow), TWO_LEVELS],
    ids=["python", "command line", "two levels"],
)
def test_recurrent_steps_load_no_torch(script):
    assert told_by(script.format(first="") + LOADED) == "False"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "script",
    [pytest.param(SOLVES, marks=pytest.mark.slow), COMMAND, TWO_LEVELS],
    ids=["python", "command line", "two levels"],
)
def test_recurrent_steps_need_no_torch(script):
    assert told_by(script.format(first=BLOCKED) + "print('done')") == "done"


@pytest.mark.slow
def test_a_layer_loads_torch():
    """So that the tests above would tell."""
    assert told_by(f"import ann_dc, sys; ann_dc.RecurrentLayer; {LOADED}") == "True"


NEEDING = {
    "acceleration": "ann_dc.RecurrentBackend(acceleration=ann_dc.Anderson())",
    "another device": "ann_dc.RecurrentBackend(device='cuda')",
    "a layer": "ann_dc.RecurrentLayer",
    "a layer of a backend": "ann_dc.RecurrentBackend().layer(None)",
    "a cell": "ann_dc.CellLayer",
}
ASKED = f"""
import sys
{BLOCKED}
import ann_dc

try:
    {{needing}}
except ImportError as error:
    print(error)
"""


@pytest.mark.sampled(2)
@pytest.mark.parametrize("needing", NEEDING.values(), ids=NEEDING)
def test_what_needs_torch_says_how_to_get_it(needing):
    reported = told_by(ASKED.format(needing=needing))
    assert reported.startswith("recurrent layers need torch, which is not installed")
    assert reported.endswith("pip install 'ann-dc[torch]'")
