"""Requests take turns, but stops overtake them."""

import asyncio

import pytest

from linked_fleet_gateway.http.scheduling import StopPriority, stop_segments


def _scope(path: str, method: str = "POST") -> dict[str, str]:
    return {"type": "http", "method": method, "path": path}


def _served(first: list[dict[str, str]], then: dict[str, str]) -> list[str]:
    """Return the paths in the order of service, when ``then`` arrives after the first of the others was served."""
    served: list[str] = []

    async def run() -> None:
        turns = StopPriority(["/calls"])
        one_is_served = asyncio.Event()

        async def serve(scope: dict[str, str]) -> None:
            await turns.wait_unless_stop(scope)
            served.append(scope["path"])
            one_is_served.set()

        async def come_later() -> None:
            await one_is_served.wait()
            await serve(then)

        await asyncio.gather(*(serve(each) for each in first), come_later())

    asyncio.run(run())
    return served


_OTHERS = [_scope(f"/r/{number}", "GET") for number in range(50)]


@pytest.mark.parametrize("segment", [*sorted(stop_segments()), "stop/"])
def test_stops_overtake_waiting_requests(segment: str) -> None:
    served = _served(_OTHERS, _scope(f"/r/actions/{segment}"))
    assert served.index(f"/r/actions/{segment}") <= 2
    assert [path for path in served if "actions" not in path] == [each["path"] for each in _OTHERS]


@pytest.mark.parametrize("scope", [_scope("/r/actions/rotate"), _scope("/r/actions/stop", "GET")])
def test_everything_else_waits_for_its_turn(scope: dict[str, str]) -> None:
    assert _served(_OTHERS, scope)[-1] == scope["path"]


def test_a_carrier_takes_its_turn_later() -> None:
    served = _served(_OTHERS, _scope("/calls"))
    assert served.index("/calls") <= 2


async def test_a_cancelled_request_delays_no_other() -> None:
    turns = StopPriority()
    waiting = [asyncio.ensure_future(turns.wait_unless_stop(_scope("/r", "GET"))) for _ in range(3)]
    await asyncio.sleep(0)
    waiting[1].cancel()
    await asyncio.gather(*waiting, return_exceptions=True)
    await turns.wait_unless_stop(_scope("/r", "GET"))
    assert [each.cancelled() for each in waiting] == [False, True, False]
