"""The records of runs at this gateway: changes of them, and who waits for these."""

import asyncio
from collections.abc import Callable, Iterator, Mapping

from linked_fleet_gateway.api import Invocation, NotFound, Table
from linked_fleet_gateway.extensions.missions.record import ENDED, OVER, Run

RETRY_S = 1.0
Change = Callable[[Run], Run]


class Runs:
    """All runs by the id of their invocation. Those in ``stopped`` begin nothing any more, before that is recorded."""

    def __init__(self, table: Table[Run]) -> None:
        self._table = table
        self.stopped: set[str] = set()
        self._awake: dict[str, asyncio.Event] = {}
        self._of_invocation: dict[str, str] = {}

    @property
    def known(self) -> Mapping[str, Run]:
        """The runs as this gateway knows them."""
        return self._table.known

    def steps_of(self, id: str) -> Iterator[str]:
        """Yield the invocations of the steps of a run, also of runs that it has begun."""
        run = self.known.get(id)
        for each in run.steps.values() if run is not None else ():
            if invocation := each.invocation.rpartition("/")[2]:
                yield invocation
                yield from self.steps_of(invocation)

    async def replace(self, id: str, run: Run | None) -> bool:
        """Replace the known record, or remove it. Return False if another gateway was faster."""
        return await self._table.change(id, run)

    async def change(self, id: str, change: Change) -> Run:
        """Change the record of a run. Return it. Raises NotFound, RedisUnavailable, and errors of ``change``."""
        if (run := await self._table.update(id, change)) is None:
            raise NotFound("The run has been deleted.")
        return run

    async def change_in_the_end(self, id: str, change: Change) -> None:
        """Change the record of a run, if it is still there, however long Redis is away."""
        await self._table.update_in_the_end(id, change)
        self.wake(id)

    # -- news -------------------------------------------------------------------------------------------------------

    def waking(self, id: str) -> asyncio.Event:
        """Return the event that is set when something of a run has changed, until ``sleep``."""
        return self._awake.setdefault(id, asyncio.Event())

    def sleep(self, id: str) -> None:
        """Forget the event of a run that is not carried out here any more."""
        self._awake.pop(id, None)

    def wake(self, id: str) -> None:
        """Let a run that is carried out here go on, because something has changed."""
        if (event := self._awake.get(id)) is not None:
            event.set()

    def note(self, id: str, run: Run | None) -> None:
        """Note the invocations of the steps of a run that have not ended."""
        if run is not None and run.phase not in OVER:
            open_ = [each.invocation for each in run.steps.values() if each.invocation and each.state not in ENDED]
            for each in open_:
                self.note_invocation(id, each.rpartition("/")[2])

    def note_invocation(self, id: str, invocation: str) -> None:
        """Note that an invocation is that of a step of a run."""
        self._of_invocation.setdefault(invocation, id)

    def of_invocation(self, invocation: Invocation) -> str | None:
        """Return the run of whose step this is the invocation; None if it is of none, or its end was noted."""
        found = self._of_invocation.get(invocation.id)
        if found is not None and invocation.state.terminal:
            self._of_invocation.pop(invocation.id)
        return found
