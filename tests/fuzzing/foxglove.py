"""Mutated messages of the Foxglove protocol, in JSON and in binary, sent to a real gateway."""

import asyncio
import json
import struct
from random import Random

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from fuzzing import mutation
from fuzzing.findings import Tally, random_of
from fuzzing.living import PATIENCE_S, LiveGateway, in_batches, living

AT_ONCE, _IN_A_ROW = 8, 25
_LONGEST = 20_000  # stays below the longest message after any replacement
_SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
_NAMES = ("/arm/maximumSpeedScale", "/arm/title", "/toy/namedPoses", "/nothing", "")
_CONTENTS = (b"{}", b"", b'{"pose": "home"}', b'{"pose": 1, "speedScale": 2}', b"[]", b"\xff")


def run(count: int, seed: int, first: int = 0) -> Tally:
    with living() as there:

        def send(tally: Tally, batch: range) -> None:
            asyncio.run(_all(there, tally, batch))

        return in_batches("foxglove", count, seed, first, there, send)


async def _all(there: LiveGateway, tally: Tally, batch: range) -> None:
    rows = iter([batch[at : at + _IN_A_ROW] for at in range(0, len(batch), _IN_A_ROW)])

    async def some() -> None:
        for row in rows:
            messages = [message(random_of(tally.seed, number)) for number in row]
            wrong = await _visit(there.port, messages, _SUBPROTOCOLS[row.start % 2])
            if wrong:
                tally.found(wrong, row.start, len(row), "\n".join(f"{each!r:.300}" for each in messages))

    await asyncio.gather(*(some() for _ in range(AT_ONCE)))


def message(random: Random) -> str | bytes:
    """Return a message; one in three is valid."""
    if random.random() < 0.3:
        return _call(random)
    document = _request(random)
    text = mutation.dumped(document if random.random() < 0.3 else mutation.tree(random, document))
    if random.random() < 0.1:
        text = mutation.raw(random, text)
    text = text[:_LONGEST]
    return text.decode("utf-8", "replace") if random.random() < 0.95 else text


def _request(random: Random) -> dict[str, object]:
    id, names = random.choice((0, 1, 2**32 - 1)), random.sample(_NAMES, random.randint(0, 3))
    value = random.choice((0.5, 1, -1, None, "x", [1.0]))
    return random.choice(
        [
            {"op": "subscribe", "subscriptions": [{"id": n, "channelId": random.randint(0, 40)} for n in range(3)]},
            {"op": "unsubscribe", "subscriptionIds": [id]},
            {"op": "getParameters", "parameterNames": names, "id": "x"},
            {"op": "setParameters", "parameters": [{"name": name, "value": value} for name in names]},
            {"op": "subscribeParameterUpdates", "parameterNames": names},
            {"op": "unsubscribeParameterUpdates", "parameterNames": names},
            {"op": "advertise", "channels": [{"id": id, "topic": "/x", "encoding": "json", "schemaName": "x"}]},
            {"op": "fetchAsset", "uri": "package://x", "requestId": id},
        ]
    )


def _call(random: Random) -> bytes:
    encoding = random.choice((b"json", b"json", b"cdr", b"", b"\xff"))
    length = len(encoding) if random.random() < 0.8 else random.choice((0, 2**31, 2**32 - 1))
    content = random.choice(_CONTENTS)
    call = struct.pack("<BIII", 2, random.randint(0, 40), random.getrandbits(32), length) + encoding + content
    return call if random.random() < 0.6 else mutation.raw(random, call)


async def _visit(port: int, messages: list[str | bytes], subprotocol: str) -> str:
    """Send everything, then a request that must be answered: the connection must survive each message."""
    url = f"ws://127.0.0.1:{port}/foxglove"
    try:
        async with asyncio.timeout(PATIENCE_S), connect(url, subprotocols=[subprotocol], compression=None) as client:  # type: ignore[list-item]
            answered = asyncio.create_task(_until_answered(client))
            for each in messages:
                await client.send(each)
            await client.send(json.dumps({"op": "getParameters", "parameterNames": ["/arm/title"], "id": "the last"}))
            await answered
    except TimeoutError:
        return "a client of Foxglove is not answered"
    except (WebSocketException, OSError) as error:
        return f"the connection of a client of Foxglove ended: {type(error).__name__}"
    return ""


async def _until_answered(client: ClientConnection) -> None:
    async for said in client:
        if isinstance(said, str) and json.loads(said).get("id") == "the last":
            return
