"""Pickling and copying of records by their fields, without cached results.

A used record caches compiled functions, evaluators and eigenvalues. These are not part of its
content, and compiled functions cannot be pickled.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

WHERE_GIVEN = "where given"
"""Metadata key of a field that a file omits if the field is None."""


class Record:
    """Dataclass that is pickled and copied by its fields and validated on creation.

    Examples
    --------
    >>> import pickle
    >>> from ann_dc import plants
    >>> problem = plants.double_integrator(N=3)
    >>> problem.functions.terminal([1.0, 0.0])[0]  # compiled, and kept
    np.float64(0.0)
    >>> pickle.loads(pickle.dumps(problem)).f == problem.f
    True
    """

    def __reduce__(self) -> tuple[Any, ...]:
        given = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        return _arrived, (type(self), given)


def _arrived(kind: type, given: dict[str, Any]) -> Any:
    return kind(**given)
