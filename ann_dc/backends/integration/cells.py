"""Whether the cells of a network are interpreted, or code is generated for them.

Generated code runs twenty times as fast, but to compile it takes as long as a few hundred runs of a
small network. It is made once for a wiring and kept on disk, whatever N, gains and inputs are. The
two agree to rounding, no further: who needs the same bits in every process says which it is to be.
"""

from __future__ import annotations

import enum
import threading
from weakref import WeakKeyDictionary

import numpy as np

from ann_dc.backends.integration.systems import Integrand, generated, interpreted
from ann_dc.errors import NetworkError
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.generated.lanes import Lanes
from ann_dc.evaluation.generated.plan import Axis, refusal
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network

EVALUATIONS = 2000
"""Of a run with its verification, as a rule."""
WORTH = 2e7
"""Neurons evaluated that take as long to interpret as code takes to be made."""

_of_thread = threading.local()
_interpreted: dict[str, float] = {}


class Cells(enum.Enum):
    """How cells are evaluated; the value is the sentence that a user reads."""

    WHERE_IT_PAYS = "generated where the code is there already, or worth making"
    INTERPRETED = "interpreted: nothing is compiled for a network"
    GENERATED = "generated: straight-line code for the wiring"

    def integrand(
        self, network: Network, compiled: CompiledEvaluator, guard: DomainGuard
    ) -> Integrand:
        """What a compiled integrator integrates.

        Parameters
        ----------
        network : Network
        compiled : CompiledEvaluator
            Of the network.
        guard : DomainGuard
            Domains of its function blocks.

        Returns
        -------
        Integrand

        Raises
        ------
        NetworkError
            If code has to be generated and the wiring is none for which it is.
        """
        why = None if self is Cells.INTERPRETED else refusal(compiled.tape)
        if why and self is Cells.GENERATED:
            raise NetworkError(f"cells: no code is generated for this network: {why}")
        if why or self is Cells.INTERPRETED:
            return interpreted(compiled, guard)
        lanes = _lanes_of(network, compiled.tape)
        if self is Cells.GENERATED or _pays(lanes, network.size):
            return generated(lanes, guard)
        return interpreted(compiled, guard)


def _lanes_of(network: Network, tape: Tape) -> Lanes:
    """The numbers of a network, kept as long as it is, with a work space for every thread."""
    kept = _of_thread.__dict__.setdefault("lanes", WeakKeyDictionary())
    if network not in kept:
        kept[network] = Lanes(tape, Axis.STAGES)
    return kept[network]


def _pays(lanes: Lanes, size: int) -> bool:
    """Whether code is there, or the work with this wiring, one more run included, is worth it.

    Whether it is there is asked once, so that what others compile meanwhile changes no result.
    """
    done = _interpreted.get(lanes.key)
    if done is None:
        done = np.inf if lanes.is_compiled else 0.0
    _interpreted[lanes.key] = done + EVALUATIONS * size
    return _interpreted[lanes.key] > WORTH
