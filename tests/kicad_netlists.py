"""A reader of KiCad's netlists, written by hand: lists of words and quoted texts."""

import re

TOKEN = re.compile(r'\s*(?:([()])|"((?:[^"\\]|\\.)*)"|([^\s()"]+))')


def read(text: str):
    """The tree of a text: a list of words, texts and lists."""
    open_lists = [[]]
    for bracket, quoted, word in TOKEN.findall(text.strip()):
        if bracket == "(":
            open_lists.append([])
        elif bracket == ")":
            done = open_lists.pop()
            open_lists[-1].append(done)
        else:
            open_lists[-1].append(word or re.sub(r"\\(.)", r"\1", quoted))
    [[tree]] = open_lists
    return tree


def entries(tree, name: str) -> list:
    """The lists within a list that begin with a word."""
    return [each for each in tree if isinstance(each, list) and each[:1] == [name]]


def entry(tree, name: str) -> str:
    """The text after a word in the only list that begins with it."""
    [[_, text]] = entries(tree, name)
    return text


def wiring_of(tree) -> dict[str, dict[str, str]]:
    """The net of every pad, by component; no component is there twice, no pad has two nets."""
    [components], [nets] = entries(tree, "components"), entries(tree, "nets")
    references = [entry(each, "ref") for each in entries(components, "comp")]
    wired: dict[str, dict[str, str]] = {reference: {} for reference in references}
    assert len(wired) == len(references)
    for net in entries(nets, "net"):
        for node in entries(net, "node"):
            pads, pad = wired[entry(node, "ref")], entry(node, "pin")
            assert pad not in pads
            pads[pad] = entry(net, "name")
    return wired
