"""The service of rules: a local copy of all rules, and their evaluation if no other gateway does it."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Collection, Iterable
from contextlib import suppress
from dataclasses import replace
from types import TracebackType
from typing import Self

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.api import Core, RequestEvent, Resource, cancel_tasks, supervised
from linked_fleet_gateway.extensions.rules.description import firings_path, rule_path
from linked_fleet_gateway.extensions.rules.edges import ChangeNotifier
from linked_fleet_gateway.extensions.rules.engine import Engine, Select, target_robot
from linked_fleet_gateway.extensions.rules.request import CONTAINER
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from linked_fleet_gateway.extensions.rules.rule_invocation import RightsEnded
from linked_fleet_gateway.extensions.rules.store import Changed, RuleStore
from linked_fleet_gateway.faces import Identity, Invoke
from linked_fleet_gateway.serving import Replica, run_last_step

log = logging.getLogger(__name__)

Check = Callable[[str, str, str], Awaitable[Collection[str]]]

KEEP_S = 0.5
"""Period of lease renewal and of checks of creators' rights."""
MEETING_S = 10.0
"""Time to wait for robots that were online at the last evaluation; afterwards their rows cease to hold."""
_RETRY_S = 0.2


class Rules:
    """An async context manager; ``limit`` is the number of rules per client."""

    def __init__(
        self,
        core: Core,
        store: RuleStore,
        select: Select,
        check: Check,
        creator_of: Callable[[Rule], Identity],
        limit: int,
    ) -> None:
        self._live, self._store, self._tell, self.limit = core.live, store, core.tell_of_request, limit
        self.bases = core.public_urls
        """The public URLs of the fleet."""
        self.check = check
        """Returns the variables of a condition, given its base and the client. Raises BadRequest, PayloadTooLarge."""
        self.known: dict[str, RuleRecord] = {}
        self._replica = Replica(store.load, store.read, self._put)
        self._core = core
        refresh = self._replica.refresh
        self._engine = Engine(
            core.live, core.invoke, store, self.known, select, creator_of, refresh, self._noted, self.bases
        )
        self._changes = ChangeNotifier(core.live, self._engine.wake)
        self._stopping: dict[str, str] = {}
        """Reasons of rules disabled here that Redis does not know yet."""
        self._written = asyncio.Event()
        self._writing: set[asyncio.Task[None]] = set()
        self._serving_since_s: float | None = None
        self._awaited: set[str] | None = None
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        self._tasks = [
            await self._replica.follow("rules", log, self._store.news),
            supervised(self._keep, "serve rules", log, "rules are not served", 0.0),
        ]
        self._core.add_copy("rules", self._replica)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([*self._tasks, *self._writing])
        self._changes.close()
        await self._engine.set_rules(set())
        await run_last_step(self._store.leave(), log, "the lease of the rules could not be released")
        await self._store.close()

    @property
    def serving(self) -> bool:
        """True if this gateway evaluates the rules."""
        return self._awaited is not None and not self._awaited

    def count_steps(self, steps_of: Callable[[str], Iterable[str]]) -> None:
        """Let motions count for a rule that are steps of what it has begun, such as a run of a mission.

        ``steps_of`` returns the ids of the invocations that are steps of an invocation.
        """
        self._engine.steps_of = steps_of

    @property
    def loops(self) -> int:
        """Number of rules disabled here because they triggered themselves."""
        return self._engine.loops

    @property
    def too_costly(self) -> int:
        """Number of rules disabled here because their conditions were too costly."""
        return self._engine.too_costly

    # -- what clients do ----------------------------------------------------------------------------------------------

    async def write(self, rule: Rule, known: RuleRecord | None) -> RuleRecord:
        """Add a rule (``known`` None), or replace the known one. Raises Full, FleetFull, Changed, RedisUnavailable.

        A stop since ``known`` was read is a change, and one that comes during the write disables the rule.
        """
        stopping = self._stopping.get(rule.id)
        if known is not None and known.rule.enabled and stopping is not None:
            raise Changed(rule.id)
        revision = 0 if known is None else known.revision
        await self._store.write(rule, revision, self.limit)
        if self._stopping.get(rule.id) == stopping:
            self._stopping.pop(rule.id, None)
        await self._replica.refresh(rule.id)
        return self.known.get(rule.id, RuleRecord(rule, revision + 1))

    async def latest(self, id: str) -> RuleRecord | None:
        """Return the rule as it is in Redis now. Raises RedisUnavailable."""
        await self._replica.refresh(id)
        return self.known.get(id)

    async def remove(self, rule: Rule, revision: int | None) -> bool:
        """Remove a rule.

        Return False if there was none. Raises Changed if ``revision`` is given and differs, RedisUnavailable.
        """
        return await self._replica.write(rule.id, self._store.remove(rule, revision))

    def note_stop(self, robots: Collection[str] | None) -> None:
        """Disable rules after a stop of these robots (None: all). The stop itself is executed first."""
        asyncio.get_running_loop().call_soon(self._disable_movers, robots)

    def _disable_movers(self, robots: Collection[str] | None) -> None:
        """Disable the rules that could move them again: here at once, at other gateways as soon as Redis has it."""
        for known in list(self.known.values()):
            if known.rule.enabled and self._moves(known.rule, robots):
                self._stopping[known.rule.id] = _reason_of_stop(known.rule, robots)
                self._put(known.rule.id, known)
                task = asyncio.create_task(self._disable(known.rule.id), name=f"disable rule {known.rule.id}")
                self._writing.add(task)
                task.add_done_callback(self._writing.discard)

    def _moves(self, rule: Rule, robots: Collection[str] | None) -> bool:
        """Return True if the rule could move one of these robots. A rule that only stops robots cannot."""
        found = None if rule.variable is not None else self._live.tree(rule.base).resolve(rule.invokes)
        offer = found.affords.offer if isinstance(found, Resource) and isinstance(found.affords, Invoke) else None
        if offer is not None and offer.is_stop:
            return False
        if robots is None:
            return True
        moved = {rule.robot} if offer is None else offer.robots
        if rule.variable is not None or moved is None:
            return any(map(rule.view.includes, robots))
        return not moved.isdisjoint(robots)

    async def _disable(self, id: str) -> None:
        while (reason := self._stopping.get(id)) is not None:
            try:
                known = await self._store.read(id)
                if known is not None and known.rule.enabled:
                    stopped = replace(known.rule, enabled=False, reason=reason)
                    await self._store.write(stopped, known.revision, self.limit)
                self._stopping.pop(id, None)
                await self._replica.refresh(id)
            except Changed:
                continue
            except RedisUnavailable:  # nothing fires without Redis either
                await asyncio.sleep(_RETRY_S)

    # -- the copy -----------------------------------------------------------------------------------------------------

    def _put(self, id: str, known: RuleRecord | None) -> None:
        before = self.known.pop(id, None)
        if known is not None:
            if known.rule.enabled and id in self._stopping:
                known = replace(known, rule=replace(known.rule, enabled=False, reason=self._stopping[id]))
            self.known[id] = known
        if (known and known.revision) != (before and before.revision):
            self._written.set()
        either = known or before
        if either is None or known == before:
            return
        old, new = (each.firings if each else {} for each in (before, known))
        fired = [number for number in {*old, *new} if old.get(number) != new.get(number)]
        paths = (CONTAINER, rule_path(either.rule), firings_path(either.rule))
        for path in (*paths, *(f"{firings_path(either.rule)}/{number}" for number in fired)):
            self._live.fan_out.mark_changed(path)

    # -- serving ------------------------------------------------------------------------------------------------------

    async def _keep(self) -> None:
        """Renew the lease or rest. During an outage of Redis nothing fires."""
        await self._serve() if await self._store.serve() else await self._rest()
        with suppress(TimeoutError):
            async with asyncio.timeout(KEEP_S):
                await self._written.wait()
        self._written.clear()

    async def _serve(self) -> None:
        if self._awaited is None:
            self._awaited, self._serving_since_s = await self._store.online_robots(), time.monotonic()
        if self._awaited:
            self._awaited = self._missing(self._awaited)
            return
        enabled = {id for id, known in self.known.items() if known.rule.enabled}
        if enabled and not self._engine.serves:
            self._changes.open()
        elif not enabled and self._engine.serves:
            self._changes.close()
        await self._engine.set_rules(enabled)
        if any(self._turned(self.known[id]) for id in enabled):
            self._engine.wake()

    def _missing(self, awaited: set[str]) -> set[str]:
        """Return robots that were online at the last evaluation and have not been seen here yet."""
        assert self._serving_since_s is not None
        if time.monotonic() - self._serving_since_s > MEETING_S:
            return set()
        robots = self._live.fleet.robots
        return {name for name in awaited if name not in robots or robots[name].sequence is None}

    def _turned(self, known: RuleRecord) -> bool:
        """Return True if its creator lost or regained the right to it."""
        try:
            self._engine.identity_of(known.rule)
        except RightsEnded as error:
            return known.suspended != str(error)
        return bool(known.suspended)

    async def _rest(self) -> None:
        """Stop evaluating, because another gateway serves the rules."""
        if self._engine.serves:
            self._changes.close()
        await self._engine.set_rules(set())
        self._awaited = self._serving_since_s = None

    def _noted(self, rule: Rule, number: int, firing: Firing) -> None:
        target = f"{firings_path(rule)}/{number}"
        robot = target_robot(rule, firing)
        status = {FiringState.ACCEPTED: 202, FiringState.UNKNOWN: 504}.get(firing.state, 409)
        who, begun = rule.creator or rule.client, firing.invocation
        self._tell(RequestEvent(who, "RULE", target, robot, status, created=begun, reason=firing.reason))


def _reason_of_stop(rule: Rule, robots: Collection[str] | None) -> str:
    """Return why a stop of these robots (None: all) disables a rule, with no robot that its readers may not see."""
    seen = [] if robots is None else sorted(filter(rule.view.includes, robots))
    whom = "all robots were" if robots is None else f"{', '.join(seen)[:200]} {'was' if len(seen) == 1 else 'were'}"
    return f"disabled because {whom} stopped"
