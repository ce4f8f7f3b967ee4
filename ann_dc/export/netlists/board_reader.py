"""KiCad netlist reader: components, and the net of every pad."""

from __future__ import annotations

from ann_dc.errors import FileFormatError
from ann_dc.export.netlists.s_expressions import Tree, entries, entry


def comments_of(tree: Tree) -> tuple[str, ...]:
    """Return the comments of a netlist's title block.

    Raises `FileFormatError` if there are fewer than two comments.
    """
    blocks = [tree]
    for name in ("design", "sheet", "title_block", "comment"):
        blocks = [inner for block in blocks for inner in entries(block, name)]
    if len(blocks) < 2:
        raise FileFormatError("KiCad netlist: its title block does not say what it is of")
    return tuple(entry(block, "value") for block in blocks)


def values_of(tree: Tree) -> dict[str, str]:
    """Return the values of a netlist's components, by reference."""
    components = [each for group in entries(tree, "components") for each in entries(group, "comp")]
    return {entry(each, "ref"): entry(each, "value") for each in components}


def wiring_of(tree: Tree) -> dict[str, dict[str, str]]:
    """Return the nets of a netlist's components, by reference and pad.

    Raises `FileFormatError` if a component occurs twice, a pad has two nets, or a net names an
    unknown component.
    """
    components = [each for group in entries(tree, "components") for each in entries(group, "comp")]
    wired: dict[str, dict[str, str]] = {entry(each, "ref"): {} for each in components}
    if len(wired) != len(components):
        raise FileFormatError("KiCad netlist: a reference is there twice")
    for net in (each for group in entries(tree, "nets") for each in entries(group, "net")):
        name = entry(net, "name")
        for node in entries(net, "node"):
            reference, pad = entry(node, "ref"), entry(node, "pin")
            if reference not in wired or pad in wired[reference]:
                raise FileFormatError(f"KiCad netlist: pad {pad!r:.20} of {reference!r:.40}")
            wired[reference][pad] = name
    return wired
