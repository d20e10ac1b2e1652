"""Examples of property-based tests: few in ``make test``, more in ``make test-long``, all in ``make test-all``.

``NEW_EXAMPLES=1`` draws others.
"""

import os

import hypothesis

LONG, ALL = "LONG_TESTS" in os.environ, "ALL_EXAMPLES" in os.environ
"""Set by ``make test-long``, which runs every property-based test again, and ``make test-all``."""
_SHARE, _MOST_SHORT, _MOST_LONG = 4, 200, 2_000


def examples(count: int, most_long: int = _MOST_LONG) -> int:
    """Return how many of the ``count`` examples of a property this run tries: at most ``most_long`` in a long one."""
    if ALL:
        return count
    return min(count, most_long) if LONG else min(max(count // _SHARE, 5), _MOST_SHORT)


def load_profile() -> None:
    """Leave out deadlines, which say nothing on a busy machine. Draw the same examples each time unless told otherwise.

    A run on a new machine then finds what the run before it found. ``make fuzz`` looks for new examples.
    """
    hypothesis.settings.register_profile(
        "ours", deadline=None, derandomize="NEW_EXAMPLES" not in os.environ, max_examples=examples(100)
    )
    hypothesis.settings.load_profile("ours")
