"""Evaluation of the cells of a network: interpreted or in generated code.

Generated code is five to twenty times as fast. Its generation takes a tenth of a second, once per
wiring: the code is cached on disk and independent of N, gains and inputs. Both evaluations agree to
rounding.
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
    """Evaluation of cells; the value is the sentence shown to the user."""

    WHERE_POSSIBLE = "generated where the wiring is one for which it is, else interpreted"
    INTERPRETED = "interpreted: nothing is compiled for a network"
    GENERATED = "generated: straight-line code for the wiring"

    def integrand(self, evaluator: FastEvaluator, guard: DomainGuard) -> Integrand:
        """Return the integrand for a compiled integrator.

        The guard contains the domains of the network's function blocks. Raises `NetworkError` if
        code is requested for a wiring without code generation.
        """
        if self is Cells.GENERATED and (why := refusal(evaluator.tape)):
            raise NetworkError(f"cells: no code is generated for this network: {why}")
        if isinstance(evaluator, GeneratedEvaluator):
            if self is not Cells.INTERPRETED:
                return generated(evaluator.lanes, guard)
            evaluator = InterpretedEvaluator(evaluator.network, evaluator.tape)
        return interpreted(evaluator, guard)
