"""The process that plans ways. It has no secrets, no network connections and a memory limit, and may be killed."""

import logging
import resource
from collections.abc import Callable
from importlib import import_module

import msgspec

from linked_fleet_base.answering import answer_questions, load_answers
from linked_fleet_gateway.extensions.navigation.messages import Answer, PlanFailed, PlanWay

MAX_MEMORY_BYTES = 2 * 2**30

log = logging.getLogger(__name__)


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s %(message)s")
    answer_questions(msgspec.msgpack.Decoder(PlanWay), answers())


def answers() -> Callable[[PlanWay], Answer]:
    """Return the function that plans ways. If a library cannot be loaded, each answer is the reason."""

    def load() -> Callable[[PlanWay], Answer]:
        plan: Callable[[PlanWay], Answer] = import_module("linked_fleet_gateway.extensions.navigation.planner").plan
        return plan

    def failed(missing: str) -> Callable[[PlanWay], Answer]:
        return lambda asked: PlanFailed(missing)

    plan = load_answers(load, "numpy", failed, "no way can be planned")

    def answer(asked: PlanWay) -> Answer:
        try:
            return plan(asked)
        except Exception:
            # The boundary: whatever a floor looks like, the process answers, and plans other ways.
            log.exception("a way could not be planned")
            return PlanFailed("an error of the planner, which the log of the gateway has")

    return answer


if __name__ == "__main__":
    main()
