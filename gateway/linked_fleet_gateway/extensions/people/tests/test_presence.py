"""Who is here: while a page is open, for a while after, and at other gateways as long as these are heard of."""

import time
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from linked_fleet_gateway.api import RequestEvent
from linked_fleet_gateway.extensions.people.presence import SILENT_S, STAY_S, Here, Presence


class Table:
    """Records of gateways, in memory."""

    def __init__(self, heard: Callable[[str, Here | None, Here | None], None]) -> None:
        self.known: dict[str, Here] = {}
        self._heard = heard

    async def change(self, run: str, record: Here | None) -> bool:
        before = self.known.pop(run, None)
        if record is not None:
            self.known[run] = record
        self._heard(run, before, record)
        return True


class Clock:
    now_s = 1000.0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(time, "monotonic", lambda: made.now_s)
    return made


def presence(changed: Callable[[], None] = lambda: None) -> Presence:
    core = SimpleNamespace(run="here", table=lambda name, kind, heard: Table(heard))
    return Presence(core, dict, changed)  # type: ignore[arg-type]


def page(one: Presence, *events: str) -> None:
    for each in events:
        one.hear(RequestEvent("ada", each, "/", "", 200, by_page=True))


async def test_somebody_is_here_until_the_last_page_is_closed_and_a_while_after(clock: Clock) -> None:
    told: list[None] = []
    one = presence(lambda: told.append(None))
    page(one, "subscribe", "subscribe", "unsubscribe")
    clock.now_s += 2 * STAY_S
    await one._look()
    assert one.people.keys() == {"ada"}
    page(one, "unsubscribe")
    clock.now_s += STAY_S - 1
    await one._look()
    assert one.people.keys() == {"ada"} and len(told) == 1
    clock.now_s += 1
    await one._look()
    assert not one.people and len(told) == 2


async def test_a_gateway_that_is_silent_is_forgotten(clock: Clock) -> None:
    one = presence()
    await one._table.change("there", Here({"ben": 7}))
    assert one.people == {"ben": 7}
    clock.now_s += SILENT_S
    assert not one.people
    clock.now_s += 1
    await one._look()
    assert one._table.known.keys() == {"here"}
