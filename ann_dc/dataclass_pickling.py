"""How records travel: into copies and other processes by their fields, without what they kept.

A record that was used keeps what it computed: compiled functions, evaluators, eigenvalues. None of
that is part of what it says, and compiled functions do not pickle.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

WHERE_GIVEN = "where given"
"""In the metadata of a field that a file leaves out where it is None."""


class Record:
    """A dataclass that is pickled and copied as its fields, and checked again on arrival.

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
