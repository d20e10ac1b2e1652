"""Findings about one requirement."""

import enum
from collections.abc import Sequence
from dataclasses import dataclass

_EVIDENCE_LENGTH = 240


class Outcome(enum.StrEnum):
    """Named as in EARL 1.0."""

    PASSED = "passed"
    FAILED = "failed"
    CANT_TELL = "cantTell"
    INAPPLICABLE = "inapplicable"


class Level(enum.StrEnum):
    """How strongly the paper asks (RFC 2119)."""

    MUST = "must"
    SHOULD = "should"
    MAY = "may"


@dataclass(frozen=True)
class Verdict:
    """``level``: where the case at hand is asked for more strongly than the requirement in general."""

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


def judged(problems: Sequence[str], evidence: str) -> Verdict:
    """Failed with the first of the problems and how many more there are, otherwise passed with the evidence."""
    if not problems:
        return passed(evidence)
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return failed(shown(problems[0], _EVIDENCE_LENGTH - len(more)) + more)


def shown(text: str, length: int = _EVIDENCE_LENGTH) -> str:
    """On one line, printable and short: what a server sends may hold anything, control sequences too."""
    clean = "".join(character if character.isprintable() else " " for character in text[: 2 * length])
    line = " ".join(clean.split())
    return line if len(line) <= length else line[: length - 1] + "…"
