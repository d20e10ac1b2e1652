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

from linked_fleet_gateway.base.answering import answer_questions
from linked_fleet_gateway.base.errors import LibraryMissing
from linked_fleet_gateway.extensions.models.simplify_messages import Simplify, SimplifyAnswer, SimplifyFailed

MAX_MEMORY_BYTES = 4 * 2**30
_NICENESS = 10  # motions and requests come first

log = logging.getLogger(__name__)


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    os.nice(_NICENESS)
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s %(message)s", level=logging.ERROR)
    answer_questions(msgspec.msgpack.Decoder(Simplify), _answering())


def _answering() -> Callable[[Simplify], SimplifyAnswer]:
    """Return the function that answers questions. If a library cannot be loaded, each answer is the reason."""
    try:
        simplify: Callable[[Simplify], SimplifyAnswer] = import_module(
            "linked_fleet_gateway.extensions.models.simplify"
        ).simplify
    except ImportError as error:
        missing = LibraryMissing.for_module("trimesh, pycollada or fast-simplification", error).detail.rstrip(".")
        log.error("no mesh can be simplified: %s", missing)
        return lambda question: SimplifyFailed(missing)
    return simplify


if __name__ == "__main__":
    main()
