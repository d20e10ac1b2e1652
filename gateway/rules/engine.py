"""Rules evaluated as the fleet changes, by the one gateway that serves them (flow "rules")."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import replace

from gateway.actions.asked import moment_of
from gateway.actions.service import Actions
from gateway.ending import end
from gateway.errors import AgentSilent, Busy, FleetError
from gateway.graph.invocation import invocation_path
from gateway.graph.paths import robot_of
from gateway.identity.rights import Identity, View
from gateway.live import Live
from gateway.rules.creators import Ended, check_action
from gateway.rules.edges import Row, Unusable, edge, holding
from gateway.rules.invoking import Moments, invoked
from gateway.rules.rule import Firing, FiringState, Known, Rule
from gateway.rules.store import Changed, Lost, RuleStore, StoreUnavailable

log = logging.getLogger(__name__)

EVERY_S = 0.1
"""The least time between two evaluations of a rule."""
SHARE = 4
"""A rule that takes long to evaluate is so in at most one of so many parts of the time."""
_RETRY_S = 0.5
_LONGEST = 1_000  # characters of a reason

Select = Callable[[str, str, View], Awaitable[Sequence[Row]]]
Note = Callable[[Rule, int, Firing], None]


class Engine:
    """``known`` are the rules by id, at any moment; ``select`` answers a query under a base URL for who sees so much;
    ``creator_of`` raises Ended; ``refresh`` has a rule read anew, ``note`` is told how each firing ended."""

    def __init__(
        self,
        live: Live,
        actions: Actions,
        store: RuleStore,
        known: Mapping[str, Known],
        select: Select,
        creator_of: Callable[[Rule], Identity],
        refresh: Callable[[str], Awaitable[None]],
        note: Note,
    ) -> None:
        self._live, self._actions, self._store, self._known = live, actions, store, known
        self._select, self._creator_of, self._refresh, self._note = select, creator_of, refresh, note
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._due: dict[str, asyncio.Event] = {}
        self._one = asyncio.Semaphore(1)
        self._seen: set[str] | None = None

    async def compare(self, ids: set[str]) -> None:
        """Serve these rules and no others from now on; what is new among them is evaluated at once."""
        for id in ids - self._tasks.keys():
            self._due[id] = asyncio.Event()
            self._due[id].set()
            self._tasks[id] = asyncio.create_task(self._serve(id), name=f"rule {id}")
        ending = [self._tasks.pop(id) for id in self._tasks.keys() - ids]
        await end(ending)
        self._due = {id: event for id, event in self._due.items() if id in ids}
        if not ids:
            self._seen = None

    def wake(self) -> None:
        """Something changed: each rule is evaluated as soon as it may be."""
        for event in self._due.values():
            event.set()

    @property
    def serves(self) -> bool:
        """Whether there are rules to evaluate here."""
        return bool(self._tasks)

    def entitled(self, rule: Rule) -> Identity:
        """Whom the rule acts for now; Ended."""
        creator = self._creator_of(rule)
        check_action(rule, self._live.tree(rule.base, creator.sees), creator)
        return creator

    async def _serve(self, id: str) -> None:
        held: tuple[int, set[str]] | None = None
        while True:
            await self._due[id].wait()
            self._due[id].clear()
            known, begun_s = self._known.get(id), time.monotonic()
            try:
                if known is not None and known.rule.enabled:
                    held = await self._evaluate(known, held)
            except (Lost, Changed, StoreUnavailable) as error:
                log.debug("rule %s is not evaluated now: %r", id, error)
                held = None
                await self._again(id)
            except Exception:
                # The boundary of the task: without it the rule would never be evaluated again.
                log.exception("rule %s could not be evaluated; it is tried again", id)
                held = None
                await self._again(id)
            await asyncio.sleep(max(EVERY_S, (time.monotonic() - begun_s) * (SHARE - 1)))

    async def _again(self, id: str) -> None:
        """What is known is not what is so: read it anew, after a moment."""
        await asyncio.sleep(_RETRY_S)
        try:
            await self._refresh(id)
        except StoreUnavailable as error:
            log.debug("rule %s cannot be read: %s", id, error)
        self._due[id].set()

    async def _evaluate(self, known: Known, held: tuple[int, set[str]] | None) -> tuple[int, set[str]] | None:
        rule, was_suspended = known.rule, bool(known.suspended)
        try:
            creator = self.entitled(rule)
        except Ended as error:
            await self._complain(known, suspended=str(error))
            return None
        moments = self._moments(creator.sees)
        try:
            async with self._one:
                rows = await self._select(rule.condition, rule.base, creator.sees)
            now = holding(rows, rule.told_apart_by)
        except Busy:  # others ask as well: at another moment
            self._due[rule.id].set()
            return held
        except (FleetError, Unusable) as error:
            # That it was suspended counts until it is evaluated: what came to hold meanwhile is nothing new.
            await self._complain(known, fault=str(error)[:_LONGEST], suspended=known.suspended)
            return held
        await self._note_seen()
        if held is None or held[0] != known.revision:
            before = None if was_suspended else await self._store.recall(known)
            if before is None:  # what holds already as it begins has not started to
                await self._store.begin(known, now)
                await self._complain(known)
                await self._refresh(rule.id)
                return known.revision, set(now)
        else:
            before = held[1]
        await self._complain(known)
        change = edge(before, now)
        if change:
            at_ns = time.time_ns()
            began = {key: Firing(at_ns, {name: str(term) for name, term in row.items()}) for key, row in change.began}
            numbers = await self._store.advance(known, began, change.ended)
            await self._fire_all(known, creator, dict(zip(numbers, change.began, strict=False)), at_ns, moments)
        return known.revision, set(now)

    def _moments(self, sees: View) -> Moments:
        """Taken before the condition is looked at: a robot that is stopped after that is told nothing by it."""
        return {name: moment_of(robot) for name, robot in self._live.fleet.robots.items() if sees.sees(name)}

    async def _note_seen(self) -> None:
        """Whoever takes over waits for the robots that were there: that they are unknown to it is no change."""
        online = {name for name, robot in self._live.fleet.robots.items() if robot.online}
        if self._seen is None:
            self._seen = await self._store.seen()
        if online != self._seen:
            await self._store.note_seen(online - self._seen, self._seen - online)
            self._seen = online

    async def _complain(self, known: Known, fault: str = "", suspended: str = "") -> None:
        if (known.fault, known.suspended) != (fault, suspended):
            await self._store.complain(replace(known, fault=fault, suspended=suspended))
            await self._refresh(known.rule.id)

    # -- firings ------------------------------------------------------------------------------------------------------

    async def _fire_all(
        self, known: Known, creator: Identity, rows: Mapping[int, tuple[str, Row]], at_ns: int, moments: Moments
    ) -> None:
        firings = [self._fire(known, creator, number, row, at_ns, moments) for number, (_, row) in rows.items()]
        await asyncio.gather(*firings)
        await self._refresh(known.rule.id)

    async def _fire(self, known: Known, creator: Identity, number: int, row: Row, at_ns: int, moments: Moments) -> None:
        rule = known.rule
        firing = Firing(at_ns, {name: str(term) for name, term in row.items()})
        firing = await self._invoke(known, creator, number, row, moments, firing)
        self._note(rule, number, firing)
        try:
            await self._store.finish(rule, number, firing)
        except StoreUnavailable as error:
            log.warning("what became of firing %d of rule %s could not be remembered: %s", number, rule.id, error)

    async def _invoke(
        self, known: Known, creator: Identity, number: int, row: Row, moments: Moments, firing: Firing
    ) -> Firing:
        present = self._known.get(known.rule.id)
        if present is None or not present.rule.enabled:
            return replace(firing, state=FiringState.FAILED, reason="the rule was disabled or deleted meanwhile")
        tree = self._live.tree(known.rule.base, creator.sees)
        try:
            invocation = await invoked(self._actions, tree, known.rule, creator, number, row, moments)
        except AgentSilent as error:
            path = error.headers.get("location", "")
            return replace(firing, state=FiringState.UNKNOWN, invocation=path, reason=str(error)[:_LONGEST])
        except FleetError as error:
            return replace(firing, state=FiringState.FAILED, reason=str(error)[:_LONGEST])
        return replace(firing, state=FiringState.ACCEPTED, invocation=invocation_path(invocation))


def robot_invoked(rule: Rule, firing: Firing) -> str:
    """The robot that a firing was about, if it was about one."""
    return robot_of(firing.invocation or rule.invokes) or ""
