"""Errors of the parsers of documents from clients."""


class ParseError(Exception):
    """A refused document. ``line`` and ``column`` count from 1; None if the syntax does not give them."""

    def __init__(self, message: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.message, self.line, self.column = message, line, column


class TooMuchError(ParseError):
    """A document with more triples than the limit."""
