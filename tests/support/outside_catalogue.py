"""Finds texts of a page that no catalogue has: those without the marks of the language ``en-XA``."""

from collections.abc import Iterator

from dom import Element

MARKED = {"accept": "text/html", "accept-language": "en-XA"}
"""The fields of a request for a page whose messages are marked."""
BEGIN, END = "⟦", "⟧"
# What people or robots have named, values and addresses: data, which no catalogue has.
_DATA = {"bdi", "code", "data", "pre", "script", "style", "textarea", "time"}
_DATA_CLASSES = {"unit", "converted", "axis", "editor"}
_READ = ("alt", "aria-label", "label", "placeholder", "title")


def outside(page: Element) -> list[str]:
    """Return the texts that people read outside of marks, each with its element."""
    return list(_Reader().outside(page))


class _Reader:
    def __init__(self) -> None:
        self._deep = 0
        """The number of messages that have begun and not ended: a message may have elements in it."""

    def outside(self, element: Element) -> Iterator[str]:
        given = _is_data(element)
        if not given and "data-about" not in element.attributes:  # which names its data too
            for name in _READ:
                text = element.get(name)
                if "://" not in text and _Reader()._rest(text):
                    yield f"<{element.tag} {name}> {text}"
        for each in element.children:
            if isinstance(each, Element):
                self._deep += given
                yield from self.outside(each)
                self._deep -= given
            elif self._rest(each) and not given:
                yield f"<{element.tag}> {each.strip()}"

    def _rest(self, text: str) -> bool:
        """Return True if a letter of the text is in no message."""
        found = False
        for each in text:
            self._deep += (each == BEGIN) - (each == END)
            found = found or (each.isalpha() and not self._deep)
        return found


def _is_data(element: Element) -> bool:
    if element.tag == "title" and element.parent is not None and element.parent.tag == "head":
        return True  # that of the page, which its heading has too
    if element.tag == "option" and "://" in element.get("value") and "linked-fleet#" not in element.get("value"):
        return True  # a part of a robot, or a unit
    marked = element.get("translate") == "no" or element.get("lang") == "en" or "data-named" in element.attributes
    return marked or element.tag in _DATA or not _DATA_CLASSES.isdisjoint(element.get("class").split())
