"""What is written of what is seen: at once what people must hear of, counts now and then, and by one gateway."""

import asyncio
import logging
from collections.abc import Mapping
from typing import Any, cast

import pytest

from linked_fleet_base.errors import ContainerFull, RedisUnavailable
from linked_fleet_gateway.api import Table
from linked_fleet_gateway.extensions.faults import ledger as module
from linked_fleet_gateway.extensions.faults.fault import Fault, Trouble
from linked_fleet_gateway.extensions.faults.ledger import COUNTS_S, MOST_WRITES, Ledger
from linked_fleet_gateway.extensions.faults.signal import Policy
from linked_fleet_gateway.extensions.faults.signals import Signals

S = 10**9


class Records:
    """A table in memory, which may be full, or be changed by another gateway just before a write."""

    def __init__(self) -> None:
        self.held: dict[str, Fault] = {}
        self.writes = list[str]()
        self.full = self.away = False
        self.others = list[tuple[str, Fault]]()

    @property
    def known(self) -> Mapping[str, Fault]:
        return self.held

    update = Table.update

    async def change(self, id: str, record: Fault | None) -> bool:
        if self.away:
            raise RedisUnavailable("Redis is away.")
        if self.full:
            raise ContainerFull("There is no room.")
        if self.others:
            self.held.update([self.others.pop()])
            return False
        self.writes.append(id)
        if record is None:
            del self.held[id]
        else:
            self.held[id] = record
        return True


class Desk:
    """A ledger at a time that a test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, kept_s: float = 3600, most: int = 1000) -> None:
        self.now_s, self.leads, self.judges = 1000.0, True, False
        monkeypatch.setattr(module.time, "time_ns", lambda: int(self.now_s * S))
        self.records, self.signals = Records(), Signals(lambda kind: Policy(0.0, 1.0))
        self.ledger = Ledger(
            cast(Any, self.records), self.signals, lambda: self.leads, lambda trouble: self.judges, kept_s, most
        )

    def see(self, *troubles: Trouble, of: str = "r") -> None:
        self.signals.show(of, troubles, int(self.now_s * S))

    def round(self, later_s: float = 0.0) -> list[str]:
        """Let a round pass, and return what it has written."""
        self.now_s += later_s
        self.records.writes = []
        asyncio.run(self.ledger.round())
        return self.records.writes


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch) -> Desk:
    return Desk(monkeypatch)


def trouble(kind: str, **more: Any) -> Trouble:
    return Trouble(kind, "/r/", ("r",), **more)


def test_counts_wait_and_states_do_not(desk: Desk) -> None:
    desk.see(trouble("a"))
    assert desk.round() == [trouble("a").id]
    for _ in range(100):
        desk.see()
        desk.see(trouble("a"))
    assert desk.round(0.5) == []
    assert desk.round(COUNTS_S) == [trouble("a").id]
    assert desk.records.held[trouble("a").id].count == 101
    desk.see()
    assert desk.round(2.0) == [trouble("a").id]
    assert desk.records.held[trouble("a").id].state == "cleared"


def test_news_come_before_counts(desk: Desk) -> None:
    flapping = [trouble(str(number)) for number in range(2 * MOST_WRITES)]
    desk.see(*flapping)
    while desk.round():
        pass
    desk.see()
    desk.see(*flapping)
    desk.see(trouble("new"), of="s")
    assert trouble("new").id in desk.round(2 * COUNTS_S)[:MOST_WRITES]


def test_a_gateway_that_does_not_lead_writes_nothing_until_it_does(desk: Desk) -> None:
    desk.leads = False
    desk.see(trouble("a"))
    desk.signals.happen(trouble("e", event=True), "1", int(desk.now_s * S))
    assert desk.round() == []
    desk.leads = True
    assert set(desk.round(10.0)) == {trouble("a").id, trouble("e").id}


def test_a_write_that_another_gateway_precedes_is_decided_anew(desk: Desk) -> None:
    told = trouble("e", event=True)
    theirs = Fault(told, "confirmed", 1, 1, 1, present=False, recent=("1",))
    desk.records.others = [(told.id, theirs)]
    desk.signals.happen(told, "1", int(desk.now_s * S))
    assert desk.round() == []
    assert desk.round(1.0) == []
    assert desk.records.held[told.id].count == 1


def test_what_is_seen_while_redis_is_away_is_written_later(desk: Desk) -> None:
    desk.records.away = True
    desk.see(trouble("a"))
    desk.signals.happen(trouble("e", event=True), "1", int(desk.now_s * S))
    with pytest.raises(RedisUnavailable):
        desk.round()
    desk.records.away = False
    assert set(desk.round(30.0)) == {trouble("a").id, trouble("e").id}
    assert desk.records.held[trouble("a").id].since_ns == 1000 * S


def test_what_nobody_sees_any_more_is_over_once_it_can_be_judged(desk: Desk) -> None:
    left = trouble("a")
    desk.records.held[left.id] = Fault(left, "confirmed", 1, 1)
    assert desk.round() == []
    desk.judges = True
    assert desk.round() == [left.id]
    assert desk.records.held[left.id].state == "cleared"


def test_cleared_faults_are_kept_for_their_time_and_number(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk(monkeypatch, kept_s=100, most=8)
    for number in range(10):
        each = trouble(str(number))
        desk.records.held[each.id] = Fault(each, "cleared", 1, 1, present=False, cleared_ns=int((990 + number) * S))
    desk.round()
    kept = {each.trouble.kind for each in desk.records.held.values()}
    assert kept == {"4", "5", "6", "7", "8", "9"}
    desk.round(98.0)
    assert {each.trouble.kind for each in desk.records.held.values()} == {"8", "9"}


def test_a_full_table_is_counted_and_logged_once(desk: Desk, caplog: pytest.LogCaptureFixture) -> None:
    desk.records.full = True
    desk.see(trouble("a"), trouble("b"))
    with caplog.at_level(logging.WARNING):
        for _ in range(5):
            desk.round(0.5)
    assert len(caplog.records) == 1
    assert desk.ledger.full == 10
