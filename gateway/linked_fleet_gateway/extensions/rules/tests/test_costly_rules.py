"""Costly rules of one client beside those of others, on virtual time."""

import asyncio
import itertools
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from pyoxigraph import Literal

from linked_fleet_gateway.extensions.query.turns import QueryTooCostly
from linked_fleet_gateway.extensions.rules.edges import Row
from linked_fleet_gateway.extensions.rules.engine import Engine, Evaluation
from linked_fleet_gateway.extensions.rules.pace import LONGEST_PAUSE_S, MOST_FAILURES, Pace
from linked_fleet_gateway.extensions.rules.rule import Rule, RuleRecord
from linked_fleet_identity.rights import ALL
from virtual.loop import on_virtual_time

LIMIT_S = 5.0
TICK_S = 0.02


def rule(id: str, client: str, condition: str) -> RuleRecord:
    return RuleRecord(Rule(id, id, condition, "/ur5/actions/stop", "http://fleet", client, 0), 1)


class Fleet:
    """Rules whose condition ``holds`` follows ``holds``, takes long (``slow``) or is too costly (``costly``)."""

    robots: dict[str, Any] = {}  # noqa: RUF012 - the fleet has none

    def __init__(self, *records: RuleRecord) -> None:
        self.known = {each.rule.id: each for each in records}
        self.holds = False
        self.evaluated: dict[str, list[float]] = {id: [] for id in self.known}
        self.fired: dict[str, float] = {}
        self.disabled: dict[str, str] = {}
        self.fleet = self
        self.invocations: Any = ()
        self.engine = _Engine(self)

    async def select(self, query: str, base: str, sees: Any, *, instead: Sequence[object] = ()) -> Sequence[Row]:
        kind, _, id = query.partition(" ")
        self.evaluated[id].append(time.monotonic())
        await asyncio.sleep({"costly": LIMIT_S, "slow": 2.0}.get(kind, 0.01))
        if kind == "costly":
            raise QueryTooCostly("The query exceeded its time limit.")
        return [{"x": Literal("up")}] if self.holds else []

    async def refresh(self, id: str) -> None:
        """Do nothing: there is one copy."""

    # -- the store ----------------------------------------------------------------------------------------------------

    async def rows_held(self, known: RuleRecord) -> None:
        return None

    async def store_first_rows(self, known: RuleRecord, rows: object) -> None:
        """Do nothing."""

    async def store_fault(self, known: RuleRecord) -> None:
        self.known[known.rule.id] = known

    async def online_robots(self) -> set[str]:
        return set()

    async def write(self, written: Rule, revision: int, limit: int) -> None:
        self.disabled[written.id] = written.reason
        self.known[written.id] = RuleRecord(written, revision + 1)

    # -- time ---------------------------------------------------------------------------------------------------------

    async def run(self, for_s: float) -> None:
        """Let rules be evaluated while something changes all the time."""
        end_s = time.monotonic() + for_s
        while time.monotonic() < end_s:
            await self.engine.set_rules({id for id, each in self.known.items() if each.rule.enabled})
            self.engine.wake()
            await asyncio.sleep(TICK_S)

    async def until_fired(self, id: str) -> float:
        """Return the seconds from the moment at which conditions begin to hold until this rule fires."""
        self.holds, begun_s = True, time.monotonic()
        while id not in self.fired:
            await self.run(TICK_S)
        return self.fired[id] - begun_s


class _Engine(Engine):
    """An engine whose rules have their rights, and whose firings are noted."""

    def __init__(self, fleet: Fleet) -> None:
        super().__init__(
            fleet, None, fleet, fleet.known, fleet.select, None, fleet.refresh, None,  # type: ignore[arg-type]
        )  # fmt: skip
        self._fleet_of_test = fleet

    def identity_of(self, rule: Rule) -> Any:
        return _Creator

    async def _advance(self, known: RuleRecord, creator: Any, change: Any, *more: Any) -> None:
        if change.began:
            self._fleet_of_test.fired.setdefault(known.rule.id, time.monotonic())

    async def _evaluate(self, known: RuleRecord, held: Evaluation | None) -> Evaluation | None:
        self._causes.observe = lambda *_: {}  # type: ignore[method-assign,assignment]
        self._causes.counterfactuals = lambda *_: ()  # type: ignore[method-assign,assignment]
        return await super()._evaluate(known, held)


class _Creator:
    visible_robots = ALL


COSTLY = [rule(f"costly-{number}", "anna", f"costly costly-{number}") for number in range(10)]
STOP = rule("stop", "ben", "holds stop")
ORDERS = [
    pytest.param([STOP, *COSTLY], id="before"),
    pytest.param([*COSTLY, STOP], id="after"),
    pytest.param([*COSTLY[:5], STOP, *COSTLY[5:]], id="between"),
]


@pytest.mark.parametrize("settled_s", [0.0, 2.0, 20.0, 200.0])
@pytest.mark.parametrize("records", ORDERS)
def test_a_rule_fires_soon_beside_ten_costly_ones_of_another_client(
    records: list[RuleRecord], settled_s: float
) -> None:
    """At worst its first evaluation waits for two costly ones; later ones wait for none."""

    async def main() -> float:
        fleet = Fleet(*records)
        while not fleet.evaluated["stop"]:
            await fleet.run(TICK_S)
        first_s = fleet.evaluated["stop"][0]
        await fleet.run(max(0.2, settled_s))
        took_s = await fleet.until_fired("stop")
        await fleet.engine.set_rules(set())
        assert first_s - min(each[0] for each in fleet.evaluated.values() if each) <= 2 * LIMIT_S + 1
        return took_s

    assert on_virtual_time(main) < 0.5


@pytest.mark.parametrize("others", [1, 3])
def test_each_client_with_costly_rules_delays_a_new_rule_once(others: int) -> None:
    async def main() -> float:
        costly = [
            rule(f"{client}-{number}", f"client {client}", f"costly {client}-{number}")
            for client, number in itertools.product(range(others), range(10))
        ]
        fleet = Fleet(*costly)
        await fleet.run(1.0)
        fleet.known["stop"], fleet.evaluated["stop"], begun_s = STOP, [], time.monotonic()
        while not fleet.evaluated["stop"]:
            await fleet.run(TICK_S)
        await fleet.engine.set_rules(set())
        return fleet.evaluated["stop"][0] - begun_s

    assert on_virtual_time(main) <= (others + 1) * LIMIT_S


def test_a_costly_rule_is_evaluated_ever_less_often_and_disabled_with_the_reason() -> None:
    async def main() -> Fleet:
        fleet = Fleet(COSTLY[0])
        await fleet.run(300.0)
        await fleet.engine.set_rules(set())
        return fleet

    fleet = on_virtual_time(main)
    times_s = fleet.evaluated["costly-0"]
    pauses_s = [round(later - sooner, 1) for sooner, later in itertools.pairwise(times_s)]
    assert len(times_s) == MOST_FAILURES
    assert pauses_s == sorted(pauses_s)
    assert "too costly 6 times in a row: The query exceeded its time limit." in fleet.disabled["costly-0"]
    assert fleet.engine.too_costly == 1


def test_enabling_or_changing_a_costly_rule_begins_the_count_anew() -> None:
    async def main() -> Fleet:
        fleet = Fleet(COSTLY[0])
        await fleet.run(12.0)  # two failures, and a pause of two seconds
        before = len(fleet.evaluated["costly-0"])
        known = fleet.known["costly-0"]
        fleet.known["costly-0"] = replace(known, rule=replace(known.rule, condition="holds costly-0"), revision=2)
        await fleet.run(1.0)
        assert len(fleet.evaluated["costly-0"]) > before
        await fleet.until_fired("costly-0")
        await fleet.engine.set_rules(set())
        return fleet

    assert not on_virtual_time(main).disabled


def test_slow_rules_do_not_delay_quick_ones_of_the_same_client() -> None:
    async def main() -> float:
        slow = [rule(f"slow-{number}", "anna", f"slow slow-{number}") for number in range(5)]
        fleet = Fleet(*slow, rule("quick", "anna", "holds quick"))
        await fleet.run(30.0)
        took_s = await fleet.until_fired("quick")
        await fleet.engine.set_rules(set())
        return took_s

    assert on_virtual_time(main) < 0.5


def test_the_pauses_are_bounded_and_end_with_a_success() -> None:
    pace, pauses_s = Pace(), []
    for _ in range(20):
        pace.fail()
        pauses_s.append(pace.pause_s)
    assert pauses_s[:3] == [1.0, 2.0, 4.0]
    assert max(pauses_s) == LONGEST_PAUSE_S
    with pace.timed():
        pass
    assert (pace.pause_s, pace.is_quick, pace.is_hopeless) == (0.0, True, False)
