"""Records by id, which are read from a copy and written if nobody else has changed them meanwhile."""

from collections.abc import Callable, Mapping
from typing import Protocol, TypeVar

T = TypeVar("T")


class Records(Protocol[T]):
    """The records of a container by id, such as a ``Table``. Writes raise RedisUnavailable and ContainerFull."""

    @property
    def known(self) -> Mapping[str, T]: ...

    async def add(self, record: T) -> str:
        """Add a record and return its id."""

    async def change(self, id: str, record: T | None) -> bool:
        """Replace the known record, or remove it for None. Return False if it has changed meanwhile."""


async def update_record(records: Records[T], id: str, update: Callable[[T], T]) -> T | None:
    """Replace the known record by what ``update`` makes of it, whoever changes it meanwhile.

    Return the record, None if it is not there any more. Raises what ``change`` and ``update`` raise.
    """
    while (record := records.known.get(id)) is not None:
        updated = update(record)
        if updated == record or await records.change(id, updated):
            return updated
    return None
