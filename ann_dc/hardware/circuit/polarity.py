r"""With which sign every part carries its node, so that few inverters are needed.

Integrators and summing amplifiers invert: a source of weight w reaches a part at polarity p with
the right sign if its own polarity is :math:`\sigma` with :math:`p\,\sigma\,w < 0`. Where some
reader needs the other sign, the source gets an inverter. Multipliers have differential inputs,
which makes products free of sign, and a differential circuit has both signs of everything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ann_dc.hardware.circuit.coupling import OWN
from ann_dc.hardware.circuit.elements import Adder, Integrator, Multiplier, Part, PICell

Chains = tuple[tuple[str, str], ...]
"""Pairs (q, t) of neurons, as in `Cell.chains`."""


def polarities(
    parts: Sequence[Part], coupling: np.ndarray | None, chains: Chains
) -> dict[str, int]:
    """Signs that need few inverters: every part's turned as long as that saves one.

    Parameters
    ----------
    parts : sequence of Part
    coupling : (C * 2N, C * 2N) array or None
        Weights from own integrators to the nodes of the chains.
    chains : tuple of pairs of neuron names
        Empty without coupling.

    Returns
    -------
    dict of node name to +1 or -1
    """
    ordered = sorted(parts, key=lambda part: isinstance(part, Multiplier))  # free of sign: last
    # a dual's output is inverted: primal and dual read each other with opposite signs
    polarity = {part.name: -1 if isinstance(part, PICell) else 1 for part in ordered}
    if coupling is not None:
        polarity |= {name: 1 for chain in chains for name in chain}
    best = len(inverted(parts, polarity, coupling, chains))
    improved = True
    while improved:
        improved = False
        for name in polarity:
            polarity[name] *= -1
            count = len(inverted(parts, polarity, coupling, chains))
            if count < best:
                best, improved = count, True
            else:
                polarity[name] *= -1
    return polarity


def inverted(
    parts: Sequence[Part],
    polarity: Mapping[str, int],
    coupling: np.ndarray | None,
    chains: Chains,
) -> set[str]:
    """Parts whose output is needed with the other sign too: one inverter each and cell.

    Parameters
    ----------
    parts : sequence of Part
    polarity : mapping of node name to +1 or -1
    coupling : (C * 2N, C * 2N) array or None
        Weights from own integrators to the nodes of the chains.
    chains : tuple of pairs of neuron names
        Empty without coupling.

    Returns
    -------
    set of str
    """
    found: set[str] = set()
    for part in parts:
        if not isinstance(part, (Integrator, PICell, Adder)):
            continue
        for wire in part.wires:
            source = polarity.get(wire.source)
            if source is None:  # an input: it comes with both signs
                continue
            if (np.sign(wire.weight) * source * polarity[part.name] > 0).any():
                found.add(wire.source)
    return found if coupling is None else found | _inverted_own(polarity, coupling, chains)


def _inverted_own(polarity: Mapping[str, int], coupling: np.ndarray, chains: Chains) -> set[str]:
    """Own integrators that an adder of the coupling needs with the other sign."""
    count, found = len(chains), set()
    # (target chain, stage, q or t; source chain, stage, q or t)
    signs = np.sign(coupling).reshape(count, -1, 2, count, coupling.shape[0] // (2 * count), 2)
    for i, targets in enumerate(chains):
        for j, sources in enumerate(chains):
            for a, target in enumerate(targets):
                for b, name in enumerate(sources):
                    source = OWN + name
                    if (signs[i, :, a, j, :, b] * polarity[source] * polarity[target] > 0).any():
                        found.add(source)
    return found
