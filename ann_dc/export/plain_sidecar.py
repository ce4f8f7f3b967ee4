"""Sidecar files of plain numbers: a descriptive manifest and a test vector."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.export.reference.sidecar import vector_of
from ann_dc.export.reference.vector import VECTOR, EulerWalk, ReferenceVector, check_states
from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash

MANIFEST = "manifest.json"
NEAR = 1e-6
"""Tolerance of another machine's end state, relative to the largest state or one."""
SHARE = 0.01
"""Permitted deviation of the number of steps, relative to the vector's steps."""


def walked(network: Network, files: Mapping[str, bytes]) -> str:
    """Run a loaded network and compare the states with its test vector.

    Returns the number of steps and the deviation as text. Raises `FileFormatError` if the vector
    belongs to another network or the states differ.
    """
    vector = vector_of(files)
    if vector.content != content_hash(network):
        raise FileFormatError(
            f"{VECTOR}: it is another network's; one of the files was changed: export the network "
            "again"
        )
    if vector.start.shape != network.live.shape:
        raise FileFormatError(f"{VECTOR}: its states do not fit the network; export it again")
    walker = EulerWalk(network, vector.step)
    off = vector.check(
        lambda start, count: network.unpack(walker.after(network.pack(start), count))
    )
    _check_end(network, vector, walker)
    return f"{max(vector.early)} steps within {off:.1e} of the reference vector"


def _check_end(network: Network, vector: ReferenceVector, walker: EulerWalk) -> None:
    """Check the number of steps, the end state and the residual against the vector."""
    steps, end, _ = walker.settled(network.pack(vector.start), vector.tolerance)
    if (steps < 0) != (vector.steps < 0) or abs(steps - vector.steps) > 1 + SHARE * vector.steps:
        raise FileFormatError(
            f"{VECTOR}.steps: {vector.steps}, but the network takes {steps}; export it again"
        )
    if vector.settles:
        check_states(network.unpack(end), vector.end, NEAR)
    residual = max(fast_evaluator(network).residuals(network.pack(vector.end)))
    if not np.isclose(residual, vector.residual, rtol=NEAR, atol=1e-3 * vector.tolerance):
        raise FileFormatError(
            f"{VECTOR}.residual: {vector.residual:.3g}, but that of its end is {residual:.3g}; "
            "export the network again"
        )
