"""Detection of rules that trigger themselves, by their latest firings. Pure; times are wall nanoseconds."""

from collections.abc import Collection

from linked_fleet_gateway.extensions.rules.rule import FiringState, RuleRecord

FIRINGS, WITHIN_S = 6, 60
"""A rule that its own firings made start to hold this often, within this many seconds, is disabled."""


def self_caused(known: RuleRecord, causes: Collection[str], at_ns: int) -> tuple[int, ...]:
    """Return the times within the last ``WITHIN_S`` at which its own firings made the rule start to hold.

    ``causes`` are the rules that caused it to hold at ``at_ns``. The latest firing of the same revision stores the
    earlier times; enabling a rule creates a new revision and so restarts the count.
    """
    claimed = [each for each in known.firings.values() if each.state is not FiringState.SUPPRESSED]
    before = claimed[-1].self_caused if claimed and claimed[-1].revision == known.revision else ()
    now = (at_ns,) if known.rule.id in causes else ()
    recent = [each for each in (*before, *now) if at_ns - each < WITHIN_S * 10**9]
    return tuple(recent[-FIRINGS:])


def reason_to_disable(known: RuleRecord, causes: Collection[str], times_ns: Collection[int]) -> str:
    """Return a sentence for people if the rule must be disabled, else an empty string."""
    if known.rule.id not in causes or len(times_ns) < FIRINGS:
        return ""
    others = sorted(each for each in causes if each != known.rule.id)
    through = f", through {', '.join(f'/rules/{id}' for id in others[:5])}" if others else ""
    return f"disabled because its own firings made it start to hold {FIRINGS} times within {WITHIN_S} s{through}"
