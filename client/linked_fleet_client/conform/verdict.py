"""Findings about one requirement."""

import enum
from collections.abc import Sequence
from dataclasses import dataclass

_EVIDENCE_LENGTH = 240


class Outcome(enum.StrEnum):
    """Outcomes as named in EARL 1.0."""

    PASSED = "passed"
    FAILED = "failed"
    CANT_TELL = "cantTell"
    INAPPLICABLE = "inapplicable"


class Level(enum.StrEnum):
    """Requirement level of the paper (RFC 2119)."""

    MUST = "must"
    SHOULD = "should"
    MAY = "may"


@dataclass(frozen=True)
class Verdict:
    """The result of one requirement; ``level`` is set if this case has a stricter level."""

    outcome: Outcome
    evidence: str
    level: Level | None = None


def passed(evidence: str) -> Verdict:
    return Verdict(Outcome.PASSED, evidence)


def failed(evidence: str) -> Verdict:
    return Verdict(Outcome.FAILED, evidence)


def cant_tell(evidence: str) -> Verdict:
    return Verdict(Outcome.CANT_TELL, evidence)


def inapplicable(evidence: str) -> Verdict:
    return Verdict(Outcome.INAPPLICABLE, evidence)


def verdict_on(problems: Sequence[str], evidence: str) -> Verdict:
    """Return failed with the first problem and the number of others, or passed with the evidence."""
    if not problems:
        return passed(evidence)
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return failed(printable(problems[0], _EVIDENCE_LENGTH - len(more)) + more)


def printable(text: str, length: int = _EVIDENCE_LENGTH) -> str:
    """Return untrusted text on one line, printable and shortened."""
    clean = "".join(character if character.isprintable() else " " for character in text[: 2 * length])
    line = " ".join(clean.split())
    return line if len(line) <= length else line[: length - 1] + "…"
