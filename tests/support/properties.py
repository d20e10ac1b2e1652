"""Examples of property-based tests: fewer in ``make test``, all in ``make test-all``, others by ``NEW_EXAMPLES=1``."""

import os

import hypothesis

LONG = "LONG_TESTS" in os.environ
"""Set by ``make test-long``, which runs every property-based test again."""
_SHARE = 4


def examples(count: int) -> int:
    """Return how many of the ``count`` examples of a property this run tries."""
    return count if LONG else max(count // _SHARE, 5)


def load_profile() -> None:
    """Leave out deadlines, which say nothing on a busy machine. Draw the same examples each time unless told otherwise.

    A run on a new machine then finds what the run before it found. ``make fuzz`` looks for new examples.
    """
    hypothesis.settings.register_profile(
        "ours", deadline=None, derandomize="NEW_EXAMPLES" not in os.environ, max_examples=examples(100)
    )
    hypothesis.settings.load_profile("ours")
