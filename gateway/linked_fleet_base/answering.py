"""A child process that answers questions on standard input: MessagePack with its length before it.

``linked_fleet_runtime.questions`` is the other side.
"""

import logging
import struct
import sys
from collections.abc import Callable
from typing import TypeVar

import msgspec

from linked_fleet_base.errors import LibraryMissing

log = logging.getLogger(__name__)

LENGTH = struct.Struct("<I")
Question = TypeVar("Question")
Answers = TypeVar("Answers", bound=Callable[..., object])


def load_answers(
    load: Callable[[], Answers], libraries: str, failed: Callable[[str], Answers], without: str
) -> Answers:
    """Return what ``load`` imports and returns; if a library cannot be loaded, what ``failed`` makes of the reason.

    It is called when the process has begun, which so outlives an ImportError and can report it. ``without`` says in the
    log what is missing then.
    """
    try:
        return load()
    except ImportError as error:
        missing = LibraryMissing.for_module(libraries, error).detail.rstrip(".")
        log.error("%s: %s", without, missing)
        return failed(missing)


def answer_questions(decoder: "msgspec.msgpack.Decoder[Question]", answer: Callable[[Question], object]) -> None:
    """Write the answer to each question on standard input until that ends."""
    stdin, stdout, encode = sys.stdin.buffer, sys.stdout.buffer, msgspec.msgpack.encode
    while head := stdin.read(LENGTH.size):
        said = encode(answer(decoder.decode(stdin.read(LENGTH.unpack(head)[0]))))
        stdout.write(LENGTH.pack(len(said)) + said)
        stdout.flush()
