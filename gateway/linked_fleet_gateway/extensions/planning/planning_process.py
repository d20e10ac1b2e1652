"""The process that plans motions. It has no secrets, no network connections and a memory limit, and may be killed.

Its argument is the folder of the mesh cache.
"""

import io
import logging
import os
import resource
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import msgspec

from linked_fleet_base.answering import answer_questions, load_answers
from linked_fleet_gateway.extensions.planning.messages import PlanAnswer, PlanFailed, PlanQuestion
from linked_fleet_gateway.extensions.world.messages import Answer, CheckFailed, Question

MAX_MEMORY_BYTES = 4 * 2**30


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    _keep_libraries_quiet()
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s %(message)s")
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    answer_questions(msgspec.msgpack.Decoder(Question | PlanQuestion), answers(folder))


def _keep_libraries_quiet() -> None:
    """Let libraries that write to the descriptors of standard output and standard error write nowhere.

    TOPP-RA tells each numerical trouble of a curve, of which the planner then takes another one.
    """
    answers_to, logs_to, nowhere = os.dup(1), os.dup(2), os.open(os.devnull, os.O_WRONLY)
    sys.stdout = io.TextIOWrapper(os.fdopen(answers_to, "wb"))
    sys.stderr = io.TextIOWrapper(os.fdopen(logs_to, "wb", buffering=0), write_through=True)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)


def answers(folder: Path | None) -> "Callable[[Question | PlanQuestion], Answer | PlanAnswer]":
    """Return the function that answers questions. If a library cannot be loaded, each answer is the reason."""

    def load() -> "Callable[[Question | PlanQuestion], Answer | PlanAnswer]":
        answer: Callable[[Question | PlanQuestion], Answer | PlanAnswer] = (
            import_module("linked_fleet_gateway.extensions.planning.worker").PlanningWorker.caching_in(folder).reply
        )
        return answer

    def failed(missing: str) -> "Callable[[Question | PlanQuestion], Answer | PlanAnswer]":
        return lambda asked: PlanFailed(missing) if isinstance(asked, PlanQuestion) else CheckFailed(missing)

    return load_answers(load, "pinocchio, coal or roboplan", failed, "no motion can be planned")


if __name__ == "__main__":
    main()
