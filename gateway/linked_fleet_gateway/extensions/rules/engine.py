"""Evaluation of rules as the fleet changes, by the one gateway that serves them (flow "rules")."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from linked_fleet_base.errors import AgentTimeout, Busy, FleetError, NotReadYet, RedisUnavailable
from linked_fleet_gateway.api import Invocation, cancel_tasks, robot_of, supervised
from linked_fleet_gateway.extensions.query.messages import HypotheticalRobot
from linked_fleet_gateway.extensions.query.turns import QueryTooCostly
from linked_fleet_gateway.extensions.rules.causes import (
    Causes,
    Look,
    begun_by,
    reason_to_disable,
    self_caused,
    state_of,
)
from linked_fleet_gateway.extensions.rules.edges import Edge, Row, UnusableResult, edge, ripe, rows_by_key
from linked_fleet_gateway.extensions.rules.pace import Pace, Queues, too_costly
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from linked_fleet_gateway.extensions.rules.rule_invocation import (
    CarryOut,
    Moments,
    RightsEnded,
    action_path,
    check_action,
    invoke,
)
from linked_fleet_gateway.extensions.rules.store import Changed, Lost, RuleStore
from linked_fleet_gateway.faces import Identity, View, invocation_path
from linked_fleet_gateway.serving import Live, robot_time

log = logging.getLogger(__name__)

EVERY_S = 0.1
"""Least time between two evaluations of a rule."""
SHARE = 4
"""A slow rule is evaluated for at most one part in this many of the time."""
_LONGEST = 1_000  # characters of a reason

Note = Callable[[Rule, int, Firing], None]
_PATIENCE_S, _RETRY_S = 30.0, 0.5  # with a gateway that has just begun


class Select(Protocol):
    """Answers a query under a base URL for a view, optionally with robots in hypothetical states."""

    def __call__(
        self, query: str, base: str, sees: View, *, instead: Sequence[HypotheticalRobot] = ()
    ) -> Awaitable[Sequence[Row]]: ...


@dataclass(frozen=True)
class Evaluation:
    """The result of a condition at ``at_s`` (monotonic): keys of the rows that held, and states of moved robots.

    ``since_s`` are the times since which each row has been there, those that have not held for long enough included.
    """

    revision: int
    keys: Collection[str]
    look: Look
    at_s: float
    since_s: Mapping[str, float]


class Engine:
    """Evaluates and fires rules.

    ``known`` are the present rules by id, ``bases`` the public URLs of the fleet. ``creator_of`` raises RightsEnded.
    ``refresh`` reads a rule again, ``note`` is called with the result of each firing.
    """

    def __init__(
        self,
        live: Live,
        carry_out: CarryOut,
        store: RuleStore,
        known: Mapping[str, RuleRecord],
        select: Select,
        creator_of: Callable[[Rule], Identity],
        refresh: Callable[[str], Awaitable[None]],
        note: Note,
        bases: Sequence[str] = (),
    ) -> None:
        self._live, self._carry_out, self._store, self._known = live, carry_out, store, known
        self._select, self._creator_of, self._refresh, self._note = select, creator_of, refresh, note
        self._bases = bases
        self._causes = Causes()
        self._begun: dict[str, frozenset[str]] = {}
        """Rules that have begun what is no motion itself, such as a run of a mission, by its invocation."""
        self.steps_of: Callable[[str], Iterable[str]] = lambda id: ()
        """Returns the ids of the invocations that are steps of an invocation."""
        self.loops = 0
        """Number of rules disabled because they triggered themselves."""
        self.too_costly = 0
        """Number of rules disabled because their conditions were too costly."""
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._due: dict[str, asyncio.Event] = {}
        self._ripening: dict[str, asyncio.TimerHandle] = {}
        self._queues = Queues()
        self._paces: dict[str, Pace] = {}
        self._seen: set[str] | None = None

    async def set_rules(self, ids: set[str]) -> None:
        """Serve exactly these rules from now on; new ones are evaluated at once."""
        if ids and not self._tasks:
            self._causes.restore(self._known.values(), self._live.fleet.robots, self._live.invocations)
            self._begun = begun_by(self._known.values())
        for id in ids - self._tasks.keys():
            self._due[id] = asyncio.Event()
            failed = f"rule {id} could not be evaluated"
            self._tasks[id] = supervised(partial(self._serve, id), f"rule {id}", log, failed)
        ending = [self._tasks.pop(id) for id in self._tasks.keys() - ids]
        await cancel_tasks(ending)
        for id in self._ripening.keys() - ids:
            self._forget_ripening(id)
        self._due = {id: event for id, event in self._due.items() if id in ids}
        self._paces = {id: pace for id, pace in self._paces.items() if id in ids}
        if not ids:
            self._seen = None

    def wake(self) -> None:
        """Schedule the evaluation of all rules after a change."""
        for event in self._due.values():
            event.set()

    @property
    def serves(self) -> bool:
        """True if there are rules to evaluate here."""
        return bool(self._tasks)

    def identity_of(self, rule: Rule) -> Identity:
        """Return the identity that the rule acts for now. Raises RightsEnded."""
        creator = self._creator_of(rule)
        check_action(rule, self._live.tree(rule.base, creator.visible_robots), creator)
        return creator

    async def _serve(self, id: str) -> None:
        """Evaluate a rule after each change. It is read again first, because it may differ after an error."""
        await self._refresh(id)
        self._due[id].set()
        held: Evaluation | None = None
        with suppress(Lost, Changed):
            while True:
                await self._due[id].wait()
                self._due[id].clear()
                known, pace = self._known.get(id), self._pace(id)
                pace.spent_s = 0.0
                if known is not None and known.rule.enabled:
                    held = await self._evaluate(known, held)
                    await self._rest(known, max(pace.spent_s * (SHARE - 1), pace.pause_s))
                await asyncio.sleep(EVERY_S)

    async def _rest(self, known: RuleRecord, rest_s: float) -> None:
        """Wait after an evaluation, unless the rule is written anew. After one that was broken off, evaluate again."""
        id, end_s = known.rule.id, time.monotonic() + rest_s
        while (left_s := end_s - time.monotonic()) > 0:
            await asyncio.sleep(min(EVERY_S, left_s))
            now = self._known.get(id)
            if now is None or now.revision != known.revision:
                self._paces.pop(id, None)
                break
        if self._pace(id).failures:
            self._due[id].set()

    def _pace(self, id: str) -> Pace:
        return self._paces.setdefault(id, Pace())

    async def _evaluate(self, known: RuleRecord, held: Evaluation | None) -> Evaluation | None:
        rule, was_suspended = known.rule, bool(known.suspended)
        if held is not None and held.revision != known.revision:
            held = None
        try:
            creator = self.identity_of(rule)
        except RightsEnded as error:
            await self._complain(known, suspended=str(error))
            return None
        moments, at_s = self._moments(creator.visible_robots), time.monotonic()
        self._note_steps()
        look = self._causes.observe(self._live.fleet.robots, self._live.invocations, at_s)
        try:
            there = await self._ask(rule, creator.visible_robots)
            before = held.keys if held is not None else None if was_suspended else await self._store.rows_held(known)
            since_s = {key: at_s if held is None else held.since_s.get(key, at_s) for key in there}
            now = there if before is None else self._ripe(rule, there, before, since_s, at_s)
            causes = (
                {} if held is None else await self._causes_of(rule, creator.visible_robots, held, edge(held.keys, now))
            )
        except Busy:  # the query process is busy: retried later
            self._due[rule.id].set()
            return held
        except (FleetError, UnusableResult) as error:
            # A suspended rule stays so until it is evaluated: rows that came to hold meanwhile do not fire.
            await self._complain(known, fault=str(error)[:_LONGEST], suspended=known.suspended)
            if isinstance(error, QueryTooCostly):  # perhaps its process was killed, so it is evaluated again
                await self._note_failure(known, error)
            return held
        await self._note_seen()
        evaluated = Evaluation(known.revision, set(now), look, at_s, since_s)
        if before is None:  # rows that hold at the start have not started to hold
            await self._store.store_first_rows(known, now)
            await self._complain(known)
            await self._refresh(rule.id)
            return evaluated
        await self._complain(known)
        await self._advance(known, creator, edge(before, now), causes, moments)
        return evaluated

    def _ripe(
        self, rule: Rule, there: Mapping[str, Row], before: Collection[str], since_s: Mapping[str, float], at_s: float
    ) -> dict[str, Row]:
        """Return the rows that held before or have held for long enough. When the next one has, evaluate."""
        now, due_s = ripe(there, before, since_s, at_s, rule.holds_for_s)
        self._forget_ripening(rule.id)
        if due_s is not None and (due := self._due.get(rule.id)) is not None:
            self._ripening[rule.id] = asyncio.get_running_loop().call_later(due_s - at_s, due.set)
        return now

    def _forget_ripening(self, id: str) -> None:
        if (timer := self._ripening.pop(id, None)) is not None:
            timer.cancel()

    async def _ask(self, rule: Rule, sees: View, instead: Sequence[HypotheticalRobot] = ()) -> dict[str, Row]:
        pace = self._pace(rule.id)
        async with self._queues.turn(rule.client, pace):
            with pace.timed():
                rows = await self._select(rule.condition, rule.base, sees, instead=instead)
        return rows_by_key(rows, rule.told_apart_by)

    async def _causes_of(self, rule: Rule, sees: View, held: Evaluation, change: Edge) -> dict[str, set[str]]:
        """Return, for each row that started to hold, the rules whose earlier firings caused it."""
        found: dict[str, set[str]] = {key: set() for key, _ in change.began}
        for question in self._causes.counterfactuals(rule.id, held.at_s, held.look) if found else ():
            then = await self._ask(rule, sees, question.robots)
            for key in found.keys() - then.keys():
                found[key] |= question.rules
        return found

    async def _advance(
        self,
        known: RuleRecord,
        creator: Identity,
        change: Edge,
        causes: Mapping[str, Collection[str]],
        moments: Moments,
    ) -> None:
        """Store the changed rows, and fire."""
        if not change:
            return
        at_ns, of_all = time.time_ns(), {id for ids in causes.values() for id in ids}
        times_ns = self_caused(known, of_all, at_ns)
        if reason := reason_to_disable(known, of_all, times_ns):
            self.loops += 1
            await self._disable(known, reason)
            return
        began = {}
        for key, row in change.began:
            bindings = {name: str(term) for name, term in row.items()}
            because = tuple(sorted(causes.get(key, ())))
            began[key] = Firing(at_ns, bindings, causes=because, self_caused=times_ns, revision=known.revision)
        numbers = await self._store.advance(known, began, change.ended)
        rows = [(row, began[key]) for key, row in change.began]
        await self._fire_all(known, creator, dict(zip(numbers, rows, strict=False)), moments)

    def _note_steps(self) -> None:
        """Take note of motions that are steps of what firings have begun."""
        robots, invocations = self._live.fleet.robots, self._live.invocations
        for id, rules in list(self._begun.items()):
            whole = invocations.get(id)
            if whole is None or whole.state.terminal:
                del self._begun[id]
                continue
            for motion in filter(None, map(invocations.get, self.steps_of(id))):
                if not motion.state.terminal and motion.robot in robots and not self._causes.knows(motion):
                    robot = robots[motion.robot]
                    self._causes.note_motion(motion, robot, rules, state_of(robot, invocations))

    async def _note_failure(self, known: RuleRecord, error: QueryTooCostly) -> None:
        pace = self._pace(known.rule.id)
        pace.fail()
        if pace.is_hopeless:
            self.too_costly += 1
            self._paces.pop(known.rule.id)
            await self._disable(known, too_costly(error.detail))

    async def _disable(self, known: RuleRecord, reason: str) -> None:
        """Disable a rule until somebody enables it again."""
        log.warning("rule %s (%s) is %s", known.rule.id, known.rule.title, reason)
        await self._store.write(replace(known.rule, enabled=False, reason=reason), known.revision, 0)
        await self._refresh(known.rule.id)

    def _moments(self, sees: View) -> Moments:
        """Record the state of robots before the evaluation: a robot that is stopped later gets no command from it."""
        return {name: robot_time(robot) for name, robot in self._live.fleet.robots.items() if sees.includes(name)}

    async def _note_seen(self) -> None:
        """Record the robots that are online, so that a gateway that takes over waits for them before evaluating."""
        online = {name for name, robot in self._live.fleet.robots.items() if robot.online}
        if self._seen is None:
            self._seen = await self._store.online_robots()
        if online != self._seen:
            await self._store.update_online_robots(online - self._seen, self._seen - online)
            self._seen = online

    async def _complain(self, known: RuleRecord, fault: str = "", suspended: str = "") -> None:
        if (known.fault, known.suspended) != (fault, suspended):
            await self._store.store_fault(replace(known, fault=fault, suspended=suspended))
            await self._refresh(known.rule.id)

    # -- firings ------------------------------------------------------------------------------------------------------

    async def _fire_all(
        self, known: RuleRecord, creator: Identity, rows: Mapping[int, tuple[Row, Firing]], moments: Moments
    ) -> None:
        firings = [self._fire(known, creator, number, *each, moments) for number, each in rows.items()]
        await asyncio.gather(*firings)
        await self._refresh(known.rule.id)

    async def _fire(
        self, known: RuleRecord, creator: Identity, number: int, row: Row, firing: Firing, moments: Moments
    ) -> None:
        rule = known.rule
        firing = await self._invoke(known, creator, number, row, moments, firing)
        self._note(rule, number, firing)
        try:
            await self._store.finish(rule, number, firing)
        except RedisUnavailable as error:
            log.warning("the result of firing %d of rule %s could not be stored: %s", number, rule.id, error)

    async def _invoke(
        self, known: RuleRecord, creator: Identity, number: int, row: Row, moments: Moments, firing: Firing
    ) -> Firing:
        rule, present = known.rule, self._known.get(known.rule.id)
        if present is None or not present.rule.enabled:
            return replace(firing, state=FiringState.FAILED, reason="the rule was disabled or deleted meanwhile")
        tree, invocations = self._live.tree(rule.base, creator.visible_robots), self._live.invocations
        try:
            path = action_path(rule, row, self._bases)
            robot = self._live.fleet.robots.get(robot_of(path) or "")
            before = None if robot is None else state_of(robot, invocations)
            carry_out = partial(invoke, self._carry_out, tree, rule, path, creator, number, row, moments)
            invocation = await _once_ready(carry_out)
        except AgentTimeout as error:
            path = error.headers.get("location", "")
            return replace(firing, state=FiringState.UNKNOWN, invocation=path, reason=str(error)[:_LONGEST])
        except FleetError as error:
            return replace(firing, state=FiringState.FAILED, reason=str(error)[:_LONGEST])
        rules = frozenset({rule.id, *firing.causes})
        if robot is not None and before is not None:
            self._causes.note_motion(invocation, robot, rules, before)
        else:
            self._begun[invocation.id] = rules
        return replace(firing, state=FiringState.ACCEPTED, invocation=invocation_path(invocation))


def target_robot(rule: Rule, firing: Firing) -> str:
    """Return the robot that a firing concerned, or an empty string."""
    return robot_of(firing.invocation or rule.invokes) or ""


async def _once_ready(carry_out: Callable[[], Awaitable[Invocation]]) -> Invocation:
    """Invoke an action, also one that a gateway that has just begun cannot judge yet. Raises FleetError."""
    until_s = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return await carry_out()
        except NotReadYet:
            if time.monotonic() > until_s:
                raise
            await asyncio.sleep(_RETRY_S)
