"""The control leases of runs: a run has those of the robots that it uses, while it is not paused and not blocked."""

import time
from contextlib import suppress

from msgspec.structs import replace

from linked_fleet_gateway.api import Conflict, Core, FleetError
from linked_fleet_gateway.extensions.missions.record import OVER, Run

LEASE_S, RENEW_S = 60.0, 15.0
"""A lease outlives the time in which another gateway goes on with a run."""
_FIRST_S = 5.0
"""The lease before the run is recorded, which nobody goes on with if its gateway dies then."""
_HELD = ("running", "ending")


class Control:
    """Takes, renews and releases the leases of the runs that this gateway carries out."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._renewed_s: dict[str, float] = {}
        """Times at which the leases of a run were taken or renewed (monotonic), while it has them."""

    async def take(self, run: Run) -> Run:
        """Take control of all robots of a new run, but those that its client controls. Return the run with its token.

        Raises Controlled, RedisUnavailable; it then has control of none.
        """
        token, taken = self._core.control_token(run.creator.lease_token), list[str]()
        try:
            for name in run.robots:
                robot = self._core.robots.get(name)
                if robot is not None and not await self._core.has_control(robot, token):
                    await self._core.take_control(robot, _holder(run), _FIRST_S, token)
                    taken.append(name)
        except FleetError:
            await self.release(replace(run, token=token, controls=tuple(taken)))
            raise
        return replace(run, token=token, controls=tuple(taken))

    async def keep(self, id: str, run: Run) -> None:
        """Renew the leases of a run, or take them again, or release them while it waits for people.

        Those that somebody else has are left to them: the next step there is refused. Raises RedisUnavailable.
        """
        if run.phase not in _HELD:
            had = self._renewed_s.pop(id, None) is not None
            if had or run.phase in OVER:  # a run that is over when it is taken over had leases elsewhere
                await self.release(run)
        elif time.monotonic() - self._renewed_s.get(id, -RENEW_S) >= RENEW_S:
            self._renewed_s[id] = time.monotonic()
            for name in run.controls:
                await self._renew(name, run)

    async def _renew(self, name: str, run: Run) -> None:
        if (robot := self._core.robots.get(name)) is not None:
            with suppress(Conflict):  # it is controlled by somebody else
                await self._core.take_control(robot, _holder(run), LEASE_S, run.token)

    async def release(self, run: Run) -> None:
        """Release the leases of a run. Those that cannot be released end by themselves."""
        for name in run.controls:
            if (robot := self._core.robots.get(name)) is not None:
                with suppress(FleetError):
                    await self._core.release_control(robot, run.token)


def _holder(run: Run) -> str:
    return f"mission {run.mission.title}, run by {run.creator.identity or run.creator.client}"[:200]
