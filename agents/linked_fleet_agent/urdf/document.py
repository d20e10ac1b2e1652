"""The XML of a description: bytes and text as they are in the field, to a bounded tree of URDF elements.

Names are read without namespaces. Elements and attributes with a prefix belong to other tools and are left out, whether
their prefix is declared or not. The elements without prefix are those of URDF, whichever default namespace they have.
"""

import codecs
import logging
import re
from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

_log = logging.getLogger(__name__)

MAX_CHARACTERS: Final = 8_000_000
MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 50_000
_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (b"<\x00?\x00", "utf-16-le"),
    (b"\x00<\x00?", "utf-16-be"),
)
_DECLARED: Final = re.compile(rb"\s*<\?xml[^>]{0,100}?encoding\s*=\s*[\"']([A-Za-z0-9._-]{1,40})[\"']")
_COMMENT: Final = re.compile(r"<!--.*?-->", re.DOTALL)
_EXPRESSION: Final = re.compile(r"\$[{(][^})]{0,60}[})]?")
_READ: Final = ("link", "joint", "material")


class UrdfError(ValueError):
    """A text that does not describe one robot. The message is a sentence for people: it says what is wrong, and
    where.
    """


def decode(content: bytes, source: str = "the description") -> str:
    """Return the text of a file in the encoding of its byte order mark or declaration, otherwise UTF-8.

    A file that is none of these is read as Latin-1, with a warning that names ``source``. Raises UrdfError.
    """
    encoding = next((name for mark, name in _MARKS if content.startswith(mark)), None)
    declared = _DECLARED.match(content)
    encoding = encoding or (declared[1].decode() if declared else "utf-8")
    try:
        return content.decode(encoding)
    except LookupError:
        raise UrdfError(f"the XML declaration names the encoding {encoding!r}, which is unknown") from None
    except UnicodeDecodeError as error:
        if declared or encoding != "utf-8":
            raise UrdfError(f"the file is no text in its encoding {encoding}: {error.reason}") from error
        line = content.count(b"\n", 0, error.start) + 1
        _log.warning("%s: line %d is not UTF-8 and no encoding is declared; it is read as Latin-1", source, line)
        return content.decode("latin-1")


def parse(text: str) -> Element:
    """Return the ``robot`` element of a description. Raises UrdfError, with the line for XML that is not well-formed.

    Document types are refused, so that no entity expands.
    """
    if len(text) > MAX_CHARACTERS:
        raise UrdfError(f"the description has {len(text)} characters; at most {MAX_CHARACTERS} are read")
    reader = _Reader()
    try:
        reader.read(text)
    except expat.ExpatError:
        # Two hyphens in a comment are common, and well-formed to the readers of ROS.
        reader = _Reader()
        reader.read_or_refuse(_COMMENT.sub(_blank, text))
    root = reader.builder.close()
    if root.tag != "robot":
        raise UrdfError(f"the root element is <{root.tag[:40]}>, not <robot>")
    _refuse_xacro(root, reader.xacro_prefixes)
    _drop_foreign(root)
    return root


def _blank(comment: re.Match[str]) -> str:
    return "\n" * comment[0].count("\n")


class _Reader:
    """Builds the tree of one text, without namespaces, comments and text between elements."""

    def __init__(self) -> None:
        self.builder = TreeBuilder()
        self.xacro_prefixes = {"xacro"}
        self._depth = self._elements = 0
        # The text is decoded already, so the encoding in its declaration has no meaning any more.
        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._refuse_doctype

    def read(self, text: str) -> None:
        """Read all of the text. Raises ExpatError for XML that is not well-formed, UrdfError for other faults."""
        start = text.lstrip("\ufeff \t\r\n")
        skipped = text.count("\n", 0, len(text) - len(start))
        try:
            self._parser.Parse(start.rstrip("\x00 \t\r\n"), True)
        except expat.ExpatError as error:
            error.lineno += skipped
            raise
        except UnicodeEncodeError as error:
            raise UrdfError(f"the URDF is no text that XML allows: {error}") from error
        finally:
            # They refer to this reader, which refers to the parser: without the cycle, memory is free at once.
            self._parser.StartElementHandler = self._parser.EndElementHandler = None

    def read_or_refuse(self, text: str) -> None:
        try:
            self.read(text)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            where = f"in line {error.lineno}, column {error.offset + 1}"
            raise UrdfError(f"the URDF is no well-formed XML: {reason} {where}") from error

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._elements += 1
        if self._depth > MAX_DEPTH:
            raise UrdfError(f"its elements are nested deeper than {MAX_DEPTH} levels")
        if self._elements > MAX_ELEMENTS:
            raise UrdfError(f"it has more than {MAX_ELEMENTS} elements")
        for name, value in attributes.items():
            if name.startswith("xmlns:") and value.rstrip("/").endswith("xacro"):
                self.xacro_prefixes.add(name[6:])
        self.builder.start(tag, attributes)

    def _end(self, tag: str) -> None:
        self._depth -= 1
        self.builder.end(tag)

    @staticmethod
    def _refuse_doctype(*_: object) -> None:
        raise UrdfError("the URDF declares a document type or an entity, which no URDF needs and this reader refuses")


def _refuse_xacro(root: Element, prefixes: set[str]) -> None:
    """Raise UrdfError for elements and expressions of xacro, with the joint or link that contains them."""
    for holder in (root, *root):
        where = f"{holder.tag} {holder.get('name', '')[:128]!r}" if holder.tag in ("link", "joint") else "the robot"
        for element in (holder,) if holder is root else holder.iter():
            _refuse_xacro_at(element, where, prefixes, holder is root or holder.tag in _READ)


def _refuse_xacro_at(element: Element, where: str, prefixes: set[str], is_read: bool) -> None:
    advice = "this is a xacro file and no URDF yet; write it with `xacro FILE.xacro > FILE.urdf`"
    if element.tag.partition(":")[0] in prefixes and ":" in element.tag:
        raise UrdfError(f"{where} contains the element <{element.tag[:60]}>: {advice}")
    for name, value in element.attrib.items() if is_read else ():
        found = _EXPRESSION.search(value)
        if found:
            raise UrdfError(f"{where} contains the expression {found[0]!r} ({name} of <{element.tag}>): {advice}")


def _drop_foreign(root: Element) -> None:
    for element in root.iter():
        if any(":" in name or name == "xmlns" for name in element.attrib):
            kept = {name: value for name, value in element.attrib.items() if ":" not in name and name != "xmlns"}
            element.attrib.clear()
            element.attrib.update(kept)
        if any(":" in child.tag for child in element):
            element[:] = [child for child in element if ":" not in child.tag]
