"""Former names of commands and options."""

import pytest
from command_line import refused, run

from ann_dc.cli.commands.app import _OnDemand
from ann_dc.cli.commands.renamed import COMMANDS, OPTIONS

KNOWN = {
    command: {name for each in loaded.params for name in each.opts}
    for command, loaded in _OnDemand().items()
}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["solve", "car", "--kinds", "multilevel"],
            "--kinds: unknown option; use --preconditioner",
        ),
        (
            ["solve", "car", "--limit=3"],
            "--limit: unknown option; use --max-settling or --max-steps",
        ),
        (["coordinate", "car", "--limit", "3"], "--limit: unknown option; use --max-iterations"),
        (["circuit", "car", "--budget", "3"], "--budget: unknown option; use --error-budget"),
        (
            ["navigate", "a.toml", "--budget", "3"],
            "--budget: unknown option; use --settling-budget",
        ),
        (["ladder", "car"], "ladder: unknown command; use levels"),
    ],
)
def test_former_name_is_refused_with_the_present_one(words, message):
    refused(words, message)


def test_present_names_exist_and_former_ones_do_not():
    options = set().union(*KNOWN.values())
    assert options.isdisjoint(OPTIONS)
    assert options.issuperset(name for names in OPTIONS.values() for name in names.split())
    assert set(KNOWN).issuperset(COMMANDS.values())
    assert set(KNOWN).isdisjoint(COMMANDS)


def test_other_unknown_option_has_the_usual_error():
    code, text = run("solve", "car", "--nix")
    assert code == 2
    assert "No such option: --nix" in text
    code, text = run("plants", "--kinds")
    assert code == 2
    assert "No such option: --kinds" in text
