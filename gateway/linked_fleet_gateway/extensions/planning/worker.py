"""The answers of the process that plans motions. Importing it loads Pinocchio, Coal and roboplan."""

import logging

from linked_fleet_gateway.extensions.planning.finder import find
from linked_fleet_gateway.extensions.planning.messages import FindStraight, PlanAnswer, PlanFailed, PlanQuestion
from linked_fleet_gateway.extensions.planning.straight import find_straight
from linked_fleet_gateway.extensions.world.messages import Answer, Question
from linked_fleet_gateway.extensions.world.path import UnknownPosition
from linked_fleet_gateway.extensions.world.worker import Worker

_log = logging.getLogger(__name__)


class PlanningWorker(Worker):
    """Prepares shapes as the check process does, and finds paths between them."""

    def reply(self, question: Question | PlanQuestion) -> Answer | PlanAnswer:
        return self._find(question) if isinstance(question, PlanQuestion) else self.answer(question)

    def _find(self, asked: PlanQuestion) -> PlanAnswer:
        around = asked.around
        prepared = all(each.key in self._robots for each in (around.robot, *around.robots))
        if not prepared or any(each.key not in self._objects for each in around.objects):
            return PlanFailed("something of it has to be prepared again")
        try:
            if isinstance(asked, FindStraight):
                return find_straight(asked, self._robots[around.robot.key])
            return find(asked, self._robots, self._objects, self._maps)
        except UnknownPosition as error:
            return PlanFailed(str(error))
        except Exception:  # noqa: BLE001 - of a library, in data of a robot or client: the process serves the others
            _log.exception("a path could not be planned")
            return PlanFailed("an error of the planner, which the log of the gateway has")
