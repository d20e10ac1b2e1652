"""Sentences for people that are made of a message and values, so that they can be said in another language.

A sentence is a string, in English. Whoever shows it to a person may translate its message, and fill in the values.
"""

import re
from collections.abc import Mapping
from typing import Self

_SLOT = re.compile(r"\{(\w+)\}")


class Sentence(str):
    """A sentence in English, with what it was made of. A value may be a sentence itself."""

    __slots__ = ("message", "values")

    message: str
    values: Mapping[str, object]

    def __new__(cls, message: str, values: Mapping[str, object]) -> Self:
        found = super().__new__(cls, fill(message, values))
        found.message, found.values = message, values
        return found


def sentence(message: str, **values: object) -> Sentence:
    """Return a message with ``values`` in the places of their names, as in ``Robot {name} is offline.``."""
    return Sentence(message, values)


def fill(message: str, values: Mapping[str, object]) -> str:
    return _SLOT.sub(lambda found: str(values.get(found[1], found[0])), message)


def offline_sentence(robot: str) -> Sentence:
    """Return why a robot that is offline does nothing."""
    return sentence("Robot {robot} is offline; its actions answer again once it is back.", robot=robot)
