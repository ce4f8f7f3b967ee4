"""Whether the cells of a network are interpreted, or code is generated for them.

Generated code runs five to twenty times as fast and takes a tenth of a second to be made, once for
a wiring: it is kept on disk, whatever N, gains and inputs are. The two agree to rounding.
"""

from __future__ import annotations

import enum

from ann_dc.backends.integration.systems import Integrand, generated, interpreted
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, GeneratedEvaluator
from ann_dc.evaluation.codegen.plan import refusal
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.interpreted import InterpretedEvaluator


class Cells(enum.Enum):
    """How cells are evaluated; the value is the sentence that a user reads."""

    WHERE_POSSIBLE = "generated where the wiring is one for which it is, else interpreted"
    INTERPRETED = "interpreted: nothing is compiled for a network"
    GENERATED = "generated: straight-line code for the wiring"

    def integrand(self, evaluator: FastEvaluator, guard: DomainGuard) -> Integrand:
        """What a compiled integrator integrates.

        Parameters
        ----------
        evaluator : FastEvaluator
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
        if self is Cells.GENERATED and (why := refusal(evaluator.tape)):
            raise NetworkError(f"cells: no code is generated for this network: {why}")
        if isinstance(evaluator, GeneratedEvaluator):
            if self is not Cells.INTERPRETED:
                return generated(evaluator.lanes, guard)
            evaluator = InterpretedEvaluator(evaluator.network, evaluator.tape)
        return interpreted(evaluator, guard)
