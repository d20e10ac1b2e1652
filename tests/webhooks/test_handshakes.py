"""Requests for consent, limited per destination, on virtual time."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence

import pytest

from linked_fleet_webhooks import delivery_pace as handshakes_module
from linked_fleet_webhooks.delivery_pace import ConsentThrottle

HOUR_S = 3600.0


class Clock:
    """A clock that advances by sleeping."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    async def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s
        await asyncio.sleep(0)


async def ask(handshakes: ConsentThrottle, clock: Clock, addresses: Sequence[str], granted: bool) -> float:
    """Return the time at which the request was made."""
    async with handshakes.turn(addresses) as turn:
        asked_s = clock()
        turn.granted = granted
        return asked_s


def times(test: Callable[[ConsentThrottle, Clock], Awaitable[list[float]]]) -> list[float]:
    async def run() -> list[float]:
        clock = Clock()
        return await test(ConsentThrottle(clock, clock.sleep), clock)

    return asyncio.run(run())


def test_a_destination_that_refuses_is_asked_ever_less_often() -> None:
    """A thousand subscriptions to one refusing host cost it fewer than seventy requests in an hour."""

    async def test(handshakes: ConsentThrottle, clock: Clock) -> list[float]:
        return await asyncio.gather(*(ask(handshakes, clock, ["8.8.8.8"], False) for _ in range(1000)))

    asked = times(test)
    assert asked == sorted(asked), "in the order of asking"
    assert asked[:8] == [0, 1, 3, 7, 15, 31, 63, 123]
    assert sum(each < HOUR_S for each in asked) < 70


def test_a_destination_that_consents_is_asked_without_pause() -> None:
    async def test(handshakes: ConsentThrottle, clock: Clock) -> list[float]:
        refused = [await ask(handshakes, clock, ["8.8.8.8"], False)]
        return refused + await asyncio.gather(*(ask(handshakes, clock, ["8.8.8.8"], True) for _ in range(100)))

    assert times(test) == [0] + 100 * [1]


def test_destinations_do_not_wait_for_each_other() -> None:
    async def test(handshakes: ConsentThrottle, clock: Clock) -> list[float]:
        asked = [await ask(handshakes, clock, ["8.8.8.8"], False)]
        return [*asked, await ask(handshakes, clock, ["1.1.1.1"], False)]

    assert times(test) == [0, 0]


def test_a_name_with_several_addresses_waits_for_each_of_them() -> None:
    """Names that share an address share its limit, whatever other addresses they have."""

    async def test(handshakes: ConsentThrottle, clock: Clock) -> list[float]:
        names = [["8.8.8.8", "1.1.1.1"], ["1.1.1.1", "9.9.9.9"], ["8.8.8.8", "9.9.9.9"]]
        return [await ask(handshakes, clock, name, False) for name in names]

    assert times(test) == [0, 1, 2]


def test_a_network_of_ipv6_addresses_is_one_destination() -> None:
    async def test(handshakes: ConsentThrottle, clock: Clock) -> list[float]:
        addresses = ("2001:db8::1", "2001:db8::ffff:1", "2001:db8:0:1::1")
        return [await ask(handshakes, clock, [each], False) for each in addresses]

    assert times(test) == [0, 1, 1]


def test_an_interrupted_request_counts_as_one() -> None:
    """A destination stays usable after the pause if a request is cancelled."""

    async def test(handshakes: ConsentThrottle, clock: Clock) -> list[float]:
        begun = asyncio.Event()

        async def hang() -> None:
            async with handshakes.turn(["8.8.8.8"]):
                begun.set()
                await asyncio.Event().wait()

        hanging = asyncio.create_task(hang())
        await begun.wait()
        hanging.cancel()
        await asyncio.wait([hanging])
        return [await ask(handshakes, clock, ["8.8.8.8"], False)]

    assert times(test) == [1]


def test_destinations_are_forgotten_beyond_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handshakes_module, "MAX_DESTINATIONS", 2)

    async def test(handshakes: ConsentThrottle, clock: Clock) -> list[float]:
        for address in ("1.0.0.1", "1.0.0.2", "1.0.0.3"):
            await ask(handshakes, clock, [address], False)
        assert len(handshakes._destinations) == 2
        return [await ask(handshakes, clock, ["1.0.0.3"], False)]

    assert times(test) == [1]
