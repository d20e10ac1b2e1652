"""Rehearsed motions that are kept for later requests. Pure values."""

from msgspec import Struct


class KeptPlan(Struct, frozen=True):
    """A rehearsed motion that is kept, by its ``id``, until a time of the wall clock."""

    id: str
    until_ns: int
