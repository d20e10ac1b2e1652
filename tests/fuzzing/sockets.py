"""WebSockets on a real gateway: nearly valid handshakes, and valid and invalid frames (RFC 6455)."""

import asyncio
import struct
from random import Random

from fuzzing import mutation
from fuzzing.findings import Tally, random_of
from fuzzing.http import judged
from fuzzing.living import PATIENCE_S, LiveGateway, in_batches, living

AT_ONCE = 32
_PATHS = (
    "/arm/pan/rotation",
    "/arm/",
    "/",
    "/arm/jointState",
    "/toy/elbow/rotation",
    "/arm/pan/rotation?depth=subtree",
    "/nothing",
)
_FIELDS = (
    ("Upgrade", ("websocket", "WebSocket", "x", "")),
    ("Connection", ("Upgrade", "keep-alive, Upgrade", "x")),
    ("Sec-WebSocket-Key", ("dGhlIHNhbXBsZSBub25jZQ==", "x", "", "dGhlIHNhbXBsZSBub25jZQ==, x")),
    ("Sec-WebSocket-Version", ("13", "8", "", "13, 8")),
)
_MORE = (
    "Sec-WebSocket-Protocol: lf.turtle", "Sec-WebSocket-Protocol: lf.frame", "Sec-WebSocket-Protocol: x",
    "Sec-WebSocket-Protocol: ,",
    "Sec-WebSocket-Extensions: permessage-deflate",
    "Sec-WebSocket-Extensions: permessage-deflate; client_max_window_bits=x",
    "Sec-WebSocket-Extensions: " + "x;" * 500, "Origin: http://evil.example", "Last-Event-ID: x", "Accept: x/y",
    "Content-Length: 5",
    "Transfer-Encoding: chunked", "Sec-WebSocket-Protocol: lf.jsonld, lf.turtle", "Accept: application/ld+json",
)  # fmt: skip
_CODES = (0, 999, 1000, 1001, 1003, 1004, 1005, 1006, 1007, 1011, 1015, 1016, 2999, 3000, 4999, 5000, 65_535)


def run(count: int, seed: int, first: int = 0) -> Tally:
    with living() as there:

        def send(tally: Tally, batch: range) -> None:
            asyncio.run(_all(there, tally, batch))

        return in_batches("sockets", count, seed, first, there, send)


async def _all(there: LiveGateway, tally: Tally, batch: range) -> None:
    numbers = iter(batch)

    async def one() -> None:
        for number in numbers:
            random = random_of(tally.seed, number)
            opening, rest = handshake(random, there.port), b"".join(frame(random) for _ in range(random.randint(0, 6)))
            wrong = await _visit(there.port, opening, rest, random.random())
            if wrong:
                tally.found(wrong, number, 1, f"{opening!r}\n{rest!r}")

    await asyncio.gather(*(one() for _ in range(AT_ONCE)))


def handshake(random: Random, port: int) -> bytes:
    """Return a handshake; four in five are valid."""
    right = random.random() < 0.8
    chosen = [(name, values[0] if right else random.choice(values)) for name, values in _FIELDS]
    lines = [f"{name}: {value}" for name, value in chosen if right or random.random() < 0.9]
    lines += random.sample(_MORE, 0 if right else random.choice((0, 1, 1, 2)))
    head = "\r\n".join([f"GET {random.choice(_PATHS)} HTTP/1.1", f"Host: 127.0.0.1:{port}", *lines, "", ""]).encode()
    return head if right or random.random() < 0.8 else mutation.raw(random, head)


def frame(random: Random) -> bytes:
    """Return a frame with any opcode, length and mask, sometimes with a wrong length."""
    opcode = random.choice((0, 1, 2, 8, 9, 10, 3, 7, 11, 15))
    first = (
        opcode
        | (0x80 if random.random() < 0.8 else 0)
        | (random.choice((0x10, 0x20, 0x40, 0x70)) if random.random() < 0.1 else 0)
    )
    payload = _payload(random, opcode)
    size = len(payload) if random.random() < 0.9 else random.choice((0, 125, 126, 65_535, 2**31, 2**63 - 1, 2**64 - 1))
    masked = random.random() < 0.9
    mask = random.randbytes(4) if masked else b""
    sent = bytes(byte ^ mask[at % 4] for at, byte in enumerate(payload)) if masked else payload
    return bytes([first]) + _length(random, size, 0x80 if masked else 0) + mask + sent


def _payload(random: Random, opcode: int) -> bytes:
    if opcode == 8 and random.random() < 0.8:
        return struct.pack(">H", random.choice(_CODES)) + random.choice((b"", b"bye", b"\xff", b"x" * 124))
    return random.choice(
        (b"", b"x", b"x" * 125, b"x" * 126, b"\xff\xfe", "é".encode(), random.randbytes(20), b"x" * 70_000)
    )


def _length(random: Random, size: int, mask: int) -> bytes:
    """Return the shortest form, or in one of ten cases a longer one, which is forbidden."""
    longer = random.random() < 0.1
    if size < 126 and not longer:
        return bytes([mask | size])
    if size < 2**16 and not (longer and size >= 126):
        return bytes([mask | 126]) + struct.pack(">H", size)
    return bytes([mask | 127]) + struct.pack(">Q", size)


async def _visit(port: int, opening: bytes, rest: bytes, whim: float) -> str:
    """Shake hands, send everything, read for a moment, and leave, sometimes by closing only one half."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(opening + rest if whim < 0.2 else opening)
        async with asyncio.timeout(PATIENCE_S):
            # The gateway may wait for the rest of a torn handshake for ever.
            said = await asyncio.wait_for(reader.readline(), 0.3 if b"\r\n\r\n" not in opening else None)
            if whim >= 0.2 and said.startswith(b"HTTP/1.1 101"):
                await reader.readuntil(b"\r\n\r\n")
                writer.write(rest)
                await _listen(reader)
            if whim > 0.97:
                writer.write_eof()
                while await reader.read(2**16):
                    pass
    except TimeoutError:
        return "" if b"\r\n\r\n" not in opening else "a WebSocket is neither answered nor closed"
    except (ConnectionError, asyncio.IncompleteReadError):
        return ""
    finally:
        writer.transport.abort()
    return judged(int(said.split(b" ")[1])) if said.startswith(b"HTTP/1.1 ") else ""


async def _listen(reader: asyncio.StreamReader) -> None:
    try:
        await asyncio.wait_for(reader.read(2**16), 0.05)
    except TimeoutError:
        return
