"""The quickest evaluator that there is for a network."""

from __future__ import annotations

from ann_dc.evaluation.generated.generated import GeneratedEvaluator
from ann_dc.evaluation.generated.plan import refusal
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network

FastEvaluator = GeneratedEvaluator | InterpretedEvaluator
"""What `fast_evaluator` gives."""


def fast_evaluator(network: Network, tape: Tape | None = None) -> FastEvaluator:
    """Generated code where the wiring is one for which it is, else loops over a tape.

    Parameters
    ----------
    network : Network
    tape : Tape, optional
        Replaces the network's own by one with other numbers.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> type(fast_evaluator(synthesize(plants.double_integrator(N=5)))).__name__
    'GeneratedEvaluator'
    """
    tape = tape or evaluator(network).tape
    return (InterpretedEvaluator if refusal(tape) else GeneratedEvaluator)(network, tape)
