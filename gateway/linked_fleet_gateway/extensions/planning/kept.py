"""A cache of what is computed of a shape of coal, which has no hash: by its identity, for the last shapes."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

import coal

_MOST = 512
T = TypeVar("T")


class Kept(Generic[T]):
    """Calls ``compute`` once for a shape. It keeps the shape, so that no other one gets its identity."""

    def __init__(self, compute: Callable[[coal.CollisionGeometry], T]) -> None:
        self._compute = compute
        self._known: OrderedDict[int, tuple[coal.CollisionGeometry, T]] = OrderedDict()

    def __call__(self, shape: coal.CollisionGeometry) -> T:
        found = self._known.pop(id(shape), None) or (shape, self._compute(shape))
        self._known[id(shape)] = found
        if len(self._known) > _MOST:
            self._known.popitem(last=False)
        return found[1]
