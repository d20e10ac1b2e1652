"""XML of others as a bounded tree of elements: no document type, so no entity expands, and no comments or texts."""

from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

MAX_CHARACTERS: Final = 8_000_000
MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 50_000
MAX_ATTRIBUTES: Final = 200_000
"""Most attributes, counted by equals signs before anything is read: the parser makes all of an element at once."""


class XmlError(ValueError):
    """A text that is no XML, or more of it than is read. The message is a sentence for people, with the line."""


class XmlReader:
    """Reads one text. ``what`` names it in errors."""

    def __init__(self, what: str, max_elements: int = MAX_ELEMENTS) -> None:
        self.namespaces: dict[str, str] = {}
        """The namespaces that prefixes are declared for, anywhere."""
        self.lines: list[int] = []
        """The line of each element, in the order of the document."""
        self._what, self._most = what, max_elements
        self._builder, self._depth, self._skipped = TreeBuilder(), 0, 0
        # The text is decoded already, so the encoding in its declaration has no meaning any more.
        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._refuse_doctype

    def read(self, text: str) -> Element:
        """Return the root of all of the text. Raises ExpatError for XML that is not well-formed, XmlError."""
        start = text.lstrip("\ufeff \t\r\n")
        self._skipped = text.count("\n", 0, len(text) - len(start))
        if (stated := text.count("=")) > MAX_ATTRIBUTES:
            raise XmlError(f"it has {stated} equals signs; a {self._what} has at most {MAX_ATTRIBUTES} attributes")
        try:
            self._parser.Parse(start.rstrip("\x00 \t\r\n"), True)
        except expat.ExpatError as error:
            error.lineno += self._skipped
            raise
        except UnicodeEncodeError as error:
            raise XmlError(f"the {self._what} is no text that XML allows: {error}") from error
        finally:
            # They refer to this reader, which refers to the parser: without the cycle, memory is free at once.
            self._parser.StartElementHandler = self._parser.EndElementHandler = None
            self._parser.StartDoctypeDeclHandler = None
        return self._builder.close()

    def read_or_refuse(self, text: str) -> Element:
        """Return the root of all of the text. Raises XmlError."""
        try:
            return self.read(text)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            where = f"in line {error.lineno}, column {error.offset + 1}"
            raise XmlError(f"the {self._what} is no well-formed XML: {reason} {where}") from error

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self.lines.append(self._parser.CurrentLineNumber + self._skipped)
        if self._depth > MAX_DEPTH:
            raise XmlError(f"its elements are nested deeper than {MAX_DEPTH} levels")
        if len(self.lines) > self._most:
            raise XmlError(f"it has more than {self._most} elements")
        self.namespaces |= {name[6:]: value for name, value in attributes.items() if name.startswith("xmlns:")}
        self._builder.start(tag, attributes)

    def _end(self, tag: str) -> None:
        self._depth -= 1
        self._builder.end(tag)

    def _refuse_doctype(self, *_: object) -> None:
        what = self._what
        raise XmlError(
            f"the {what} declares a document type or an entity, which no {what} needs and this reader refuses"
        )
