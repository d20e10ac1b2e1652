"""A child process that answers questions on standard input: MessagePack with its length before it.

``linked_fleet_gateway.runtime.questions`` is the other side.
"""

import struct
import sys
from collections.abc import Callable
from typing import TypeVar

import msgspec

LENGTH = struct.Struct("<I")
Question = TypeVar("Question")


def answer_questions(decoder: "msgspec.msgpack.Decoder[Question]", answer: Callable[[Question], object]) -> None:
    """Write the answer to each question on standard input until that ends."""
    stdin, stdout, encode = sys.stdin.buffer, sys.stdout.buffer, msgspec.msgpack.encode
    while head := stdin.read(LENGTH.size):
        said = encode(answer(decoder.decode(stdin.read(LENGTH.unpack(head)[0]))))
        stdout.write(LENGTH.pack(len(said)) + said)
        stdout.flush()
