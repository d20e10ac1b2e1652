"""The check process: questions on standard input, answers on standard output, until the input ends.

It parses data of robots and clients with libraries that were not made for untrusted input. So it has no secrets, no
network connections and a memory limit, and may be killed at any time. Its argument is the folder of the mesh cache.
"""

import logging
import resource
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import msgspec

from linked_fleet_base.answering import answer_questions, load_answers
from linked_fleet_gateway.extensions.world.messages import Answer, CheckFailed, Question

MAX_MEMORY_BYTES = 4 * 2**30


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s %(message)s")
    answer_questions(msgspec.msgpack.Decoder(Question), answers(Path(sys.argv[1]) if len(sys.argv) > 1 else None))


def answers(folder: Path | None) -> Callable[[Question], Answer]:
    """Return the function that answers questions. If a library cannot be loaded, each answer is the reason."""

    def load() -> Callable[[Question], Answer]:
        answer: Callable[[Question], Answer] = (
            import_module("linked_fleet_gateway.extensions.world.worker").Worker.caching_in(folder).answer
        )
        return answer

    def failed(missing: str) -> Callable[[Question], Answer]:
        return lambda question: CheckFailed(missing)

    return load_answers(load, "pinocchio or coal", failed, "no motion of a placed robot can be checked")


if __name__ == "__main__":
    main()
