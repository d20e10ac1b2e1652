"""The cost of joining robots for plain Zenoh: a session like the gateway's, which requests each new description.

``python -m bench.greeter ENDPOINT`` prints a line for each robot that it has met, until it is killed.
"""

import queue
import sys
import threading

import zenoh

from bench.references import session_of_gateway
from linked_fleet_agent.wire.keys import Keys

_KEYS = Keys()
_AT_ONCE = 8  # concurrent questions, as many as in a gateway


class Greeter:
    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._come: queue.SimpleQueue[str] = queue.SimpleQueue()
        states = session.declare_subscriber(_KEYS.all_states, zenoh.handlers.FifoChannel(4096))
        presence = session.liveliness().declare_subscriber(_KEYS.all_presence, self._hear, history=True)
        self._kept = (states, presence)

    def _hear(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._come.put(_KEYS.parse(str(sample.key_expr)).robot)

    def greet_for_ever(self) -> None:
        while True:
            robot = self._come.get()
            for reply in self._session.get(_KEYS.robot(robot, "description")):
                if reply.ok is not None and reply.ok.payload.to_bytes():
                    sys.stdout.write(f"met {robot}\n")  # in one write, because other threads print too


def main() -> None:
    with session_of_gateway(sys.argv[1]) as session:
        greeter = Greeter(session)
        for _ in range(_AT_ONCE - 1):
            threading.Thread(target=greeter.greet_for_ever, daemon=True).start()
        greeter.greet_for_ever()


if __name__ == "__main__":
    main()
