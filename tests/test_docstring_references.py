"""References in docstrings to names that do not exist."""

import subprocess
import sys
from pathlib import Path

import docstring_references
import pytest

import ann_dc.evaluation.loops
import ann_dc.network.network
from ann_dc.network import network

NAMES = docstring_references.Names([ann_dc, ann_dc.evaluation.loops, network])


@pytest.mark.parametrize(
    "reference",
    [
        "ann_dc.solve",
        "ann_dc.network.network.Network.stages",  # a field: instances have it
        "loops.residuals",  # a module by its last name
        "Network.neuron_index",
        "network.stages",  # an instance by the name of its module
        "mu.phi",  # a neuron
        "matplotlib.figure.Figure",
    ],
)
def test_what_exists_or_is_none_of_ours_is_let_through(reference):
    assert not NAMES.broken(reference, network)


@pytest.mark.parametrize(
    "reference",
    [
        "ann_dc.solved",
        "loops.remainders",
        "Network.no_such_field",
        "Program.nodes",
        "old.Wiring.add",
    ],
)
def test_what_does_not_exist_is_found(reference):
    assert NAMES.broken(reference, network)


@pytest.mark.slow
def test_no_docstring_refers_to_what_does_not_exist():
    """In a process of its own: every module is loaded, torch among them."""
    program = (
        "import docstring_references as a; print(*a.broken_references(a.modules()), sep='\\n')"
    )
    folder = Path(docstring_references.__file__).parent
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, cwd=folder)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stdout + done.stderr


def test_a_broken_reference_is_told_with_its_place():
    def documented():
        """See `Network.no_such_field` and :func:`ann_dc.solve`."""

    documented.__module__ = module = "ann_dc.made_up"
    made_up = type(ann_dc)(module)
    made_up.documented, made_up.Network = documented, network.Network
    found = docstring_references.broken_references([ann_dc, made_up])
    assert found == ["ann_dc.made_up.documented: `Network.no_such_field` does not exist"]
