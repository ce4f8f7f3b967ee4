"""Whether the cells of a network are interpreted, or code is generated for them.

Generated code runs five to twenty times as fast and takes a tenth of a second to be made, once for a
wiring: it is kept on disk, whatever N, gains and inputs are. The two agree to rounding.
"""

from __future__ import annotations

import enum
import threading
from weakref import WeakKeyDictionary

from ann_dc.backends.integration.systems import Integrand, generated, interpreted
from ann_dc.errors import NetworkError
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.generated.lanes import Lanes
from ann_dc.evaluation.generated.plan import Axis, refusal
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network

_of_thread = threading.local()


class Cells(enum.Enum):
    """How cells are evaluated; the value is the sentence that a user reads."""

    WHERE_POSSIBLE = "generated where the wiring is one for which it is, else interpreted"
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
        return generated(_lanes_of(network, compiled.tape), guard)


def _lanes_of(network: Network, tape: Tape) -> Lanes:
    """The numbers of a network, kept as long as it is, with a work space for every thread."""
    kept = _of_thread.__dict__.setdefault("lanes", WeakKeyDictionary())
    if network not in kept:
        kept[network] = Lanes(tape, Axis.STAGES)
    return kept[network]
