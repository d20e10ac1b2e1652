"""An agent whose robot does not move: the cost of an agent without its driver.

``python -m bench.still_agent ENDPOINT JOINTS RATE_HZ`` runs until its standard input ends.
"""

import asyncio
import sys
from collections.abc import Mapping

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robot import Facts, JointFacts, Limits, Reading
from linked_fleet_agent.serving import link_of
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.zenoh_session import open_session


class Still:
    """A driver of so many continuous joints that never move."""

    def __init__(self, joints: int) -> None:
        facts = [
            JointFacts(f"joint_{number}", limits=Limits(velocity=2.0), continuous=True) for number in range(joints)
        ]
        links = "".join(f'<link name="link_{number}"/>' for number in range(joints + 1))
        chain = "".join(
            f'<joint name="joint_{number}" type="continuous"><parent link="link_{number}"/>'
            f'<child link="link_{number + 1}"/><limit velocity="2" effort="1"/></joint>'
            for number in range(joints)
        )
        self._facts = Facts("Still", f'<robot name="still">{links}{chain}</robot>', tuple(facts))
        self._reading = Reading((0.1,) * joints, (0.0,) * joints, (0.5,) * joints)

    def describe(self) -> Facts:
        return self._facts

    def read(self, now_s: float) -> Reading:
        return self._reading

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        return setpoints

    def stop(self) -> None:
        """Do nothing: the robot does not move."""

    def close(self) -> None:
        """Do nothing."""


async def main() -> None:
    endpoint, joints, rate_hz = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    agent, keys = Agent("still", Still(joints), rate_hz=rate_hz), Keys()
    async with open_session((endpoint,)) as session, link_of(agent, session, keys) as link:
        running = asyncio.create_task(agent.run(link))
        print("runs", flush=True)
        await asyncio.to_thread(sys.stdin.read)
        running.cancel()
        await asyncio.wait([running])


if __name__ == "__main__":
    asyncio.run(main())
