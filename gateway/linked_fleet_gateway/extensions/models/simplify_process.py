"""The process that simplifies meshes: questions on standard input, answers on standard output, until the input ends.

It parses data of robots with libraries that were not made for untrusted input. So it has no secrets, no network
connections and a memory limit, and may be killed at any time.
"""

import logging
import os
import resource
from collections.abc import Callable
from importlib import import_module

import msgspec

from linked_fleet_base.answering import answer_questions, load_answers
from linked_fleet_gateway.extensions.models.simplify_messages import Simplify, SimplifyAnswer, SimplifyFailed

MAX_MEMORY_BYTES = 4 * 2**30
_NICENESS = 10  # motions and requests come first


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    os.nice(_NICENESS)
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s %(message)s", level=logging.ERROR)
    answer_questions(msgspec.msgpack.Decoder(Simplify), _answering())


def _answering() -> Callable[[Simplify], SimplifyAnswer]:
    """Return the function that answers questions. If a library cannot be loaded, each answer is the reason."""

    def load() -> Callable[[Simplify], SimplifyAnswer]:
        simplify: Callable[[Simplify], SimplifyAnswer] = import_module(
            "linked_fleet_gateway.extensions.models.simplify"
        ).simplify
        return simplify

    def failed(missing: str) -> Callable[[Simplify], SimplifyAnswer]:
        return lambda question: SimplifyFailed(missing)

    return load_answers(load, "trimesh, pycollada or fast-simplification", failed, "no mesh can be simplified")


if __name__ == "__main__":
    main()
