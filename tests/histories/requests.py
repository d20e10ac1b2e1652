"""Clients that request motions of joints and of components with idempotency keys, and repeat requests."""

import json
import random

from histories.gateways import Gateway
from histories.history import History
from histories.keys import Keys
from histories.robots import JOINT
from linked_fleet_agent.wire.messages import Move
from linked_fleet_base.errors import AgentTimeout, Busy, KeyReused, NotReadYet, RefusedByAgent
from linked_fleet_gateway.actions.plan import Act, Caller, Motion, robot_time

_MODEL = "key"
_OTHER = 0.1  # share of requests that differ from the first one with their key
_STEP = 1e-6


class MotionClients:
    """Each key has a target of its own, which identifies the key of a running command."""

    def __init__(self, history: History, robots: list[str], uses: int) -> None:
        self._history, self._robots = history, robots
        self._keys = Keys(history, lambda: history.label("key-"), count=4, uses=uses)
        self._of_target: dict[float, str] = {}
        self._numbers: dict[str, int] = {}

    def ran(self, command: str, target: float, since_ns: int) -> None:
        """Record that a robot has begun a command."""
        self._history.happened(_MODEL, self._of_target[target], "ran", since_ns, id=command)

    async def act(self, client: int, gateway: Gateway, draws: random.Random) -> None:
        key = self._keys.pick(draws)
        digest = "other" if draws.random() < _OTHER else "same"
        motion = self._motion(key, gateway)
        called = self._history.calls(client, _MODEL, key, "begin", digest=digest)
        try:
            began = await gateway.actions.start(
                "/toy/elbow/actions/rotate", motion, Caller(idempotency_key=key, request_digest=digest)
            )
        except KeyReused:
            called.answered(is_="reused")
        except (Busy, NotReadYet):
            called.answered(is_="refused")
        except RefusedByAgent:
            called.answered(id="?")
        except AgentTimeout as silence:
            called.answered(id=silence.headers["location"].rpartition("/")[2])
        else:
            called.answered(id=began.id)

    def _motion(self, key: str, gateway: Gateway) -> Motion:
        number = self._numbers.setdefault(key, len(self._numbers))
        target, name = number * _STEP, self._robots[number % len(self._robots)]
        self._of_target[target] = key
        robot = gateway.live.fleet.robots[name]
        moment = robot_time(robot)
        assert moment is not None
        if number % 2:  # an action of a component
            act = Act("hand", json.dumps({"at": target}).encode(), "grip", moves=(JOINT,))
            return Motion(robot, act, {}, moment)
        return Motion(robot, Move({JOINT: target}), {JOINT: target}, moment)

    async def settle(self, gateway: Gateway) -> None:
        """Do nothing: the commands that ran are recorded as they run."""
