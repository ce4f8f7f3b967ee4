"""Cached results of records, and pickling and copying without them.

A used record caches compiled functions, evaluators and eigenvalues. These are not part of its
content, and compiled functions cannot be pickled.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import fields
from typing import Any, TypeVar

_Result = TypeVar("_Result")

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


def cached_on(record: object, name: str, key: Hashable, compute: Callable[[], _Result]) -> _Result:
    """Return a result that is computed once per record and key, as long as the record exists.

    The results are stored under ``name``, next to the cached properties of the record.
    """
    results = vars(record).setdefault(name, {})
    if key not in results:
        results[key] = compute()
    return results[key]


def _arrived(kind: type, given: dict[str, Any]) -> Any:
    return kind(**given)
