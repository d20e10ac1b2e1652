"""The command to an agent for a motion."""

from linked_fleet_agent.wire.messages import WIRE_VERSION, Command
from linked_fleet_gateway.actions.plan import Motion

TIME_TO_LIVE_NS = 2_000_000_000


def command_of(id: str, motion: Motion, *, rehearsal: bool = False) -> Command:
    """Return the command, with the moment of the request, whatever time has passed since."""
    return Command(
        version=WIRE_VERSION,
        id=id,
        incarnation=motion.asked.incarnation,
        seen_ns=motion.asked.seen_ns,
        time_to_live_ns=TIME_TO_LIVE_NS + motion.asked.waited_ns,
        motion=motion.motion,
        scale=motion.scale,
        expects=dict(motion.expects),
        rehearsal=rehearsal,
    )
