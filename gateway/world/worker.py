"""The process that checks motions: a question on standard input, an answer on standard output, until the input ends.

It reads what robots and clients send, in libraries that were not made for strangers' bytes: it has no secrets, no
network of its own accord, a bound on its memory, and may be ended at any time.
"""

import resource
import struct
import sys
from typing import BinaryIO

import coal
import msgspec

from gateway.fleet.xml import ModelError
from gateway.world.messages import Answer, Check, Prepare, Question, Ready, Unable
from gateway.world.shapes import Robot, object_of, robot_of
from gateway.world.sweep import check

MAX_MEMORY_BYTES = 4 * 2**30
LENGTH = struct.Struct("<I")


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    decoder, encode = msgspec.msgpack.Decoder(Question), msgspec.msgpack.encode
    robots: dict[str, Robot] = {}
    objects: dict[str, coal.CollisionGeometry] = {}
    stdin, stdout = sys.stdin.buffer, sys.stdout.buffer
    while head := stdin.read(LENGTH.size):
        answer = encode(_answer(decoder.decode(_read(stdin, head)), robots, objects))
        stdout.write(LENGTH.pack(len(answer)) + answer)
        stdout.flush()


def _read(stdin: BinaryIO, head: bytes) -> bytes:
    return stdin.read(LENGTH.unpack(head)[0])


def _answer(question: Question, robots: dict[str, Robot], objects: dict[str, coal.CollisionGeometry]) -> Answer:
    if isinstance(question, Check):
        return check(question, robots, objects)
    try:
        if isinstance(question, Prepare):
            robots[question.key] = robot_of(question.urdf, question.meshes)
        else:
            objects[question.key] = object_of(question.geometry)
    except (ModelError, MemoryError, RuntimeError) as error:
        return Unable(f"its shape cannot be used: {error}")
    return Ready()


if __name__ == "__main__":
    main()
