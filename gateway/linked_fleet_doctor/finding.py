"""Results of checks and their display. Pure."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_WIDTH = 12


@dataclass(frozen=True)
class Finding:
    """One sentence about one subject. With ``advice`` it reports a fault, unless it is only a ``note``."""

    subject: str
    sentence: str
    advice: str = ""
    is_note: bool = False

    @property
    def is_fault(self) -> bool:
        return bool(self.advice) and not self.is_note

    def __str__(self) -> str:
        level = "WRONG" if self.is_fault else "note" if self.is_note else "ok"
        said = f"{self.sentence}; {self.advice}" if self.advice else self.sentence
        return f"{level:6}{self.subject:{_WIDTH}}{said}"


def summary(findings: Sequence[Finding]) -> str:
    wrong = sum(each.is_fault for each in findings)
    if not wrong:
        return "nothing is wrong"
    return "1 thing is wrong" if wrong == 1 else f"{wrong} things are wrong"


def format_findings(findings: Iterable[Finding]) -> str:
    return "\n".join(str(each) for each in findings)
