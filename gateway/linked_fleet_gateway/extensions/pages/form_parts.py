"""The parts of a form: values, nodes of their own, and the form itself, as the template writes them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

_GRAPHS = frozenset({"turtle"})


@dataclass(frozen=True)
class Leaf:
    """One value. ``input`` is the type of its element; ``limits`` is JSON for `face/src/limits.js`, or empty.

    ``when``: the types of its node that it is for, where it is not for all. ``editor``: the language of a text, for
    `face/src/editor.js`. ``variable``: ``?name`` stands for a node that names a variable. ``further``: the values
    after the first.
    """

    path: str
    label: str
    hint: str
    required: bool
    input: str
    iri: bool
    datatype: str
    value: str = ""
    options: Sequence[tuple[str, str]] = ()
    limits: str = ""
    step: str = ""
    most: int = 1
    when: Sequence[str] = ()
    editor: str = ""
    variable: bool = False
    further: Sequence[str] = ()
    kind: ClassVar[str] = "leaf"

    @property
    def says(self) -> str:
        """How `face/src/form.js` makes a term of it."""
        return (
            self.editor if self.editor in _GRAPHS else "variable" if self.variable else "iri" if self.iri else "literal"
        )

    @property
    def repeated(self) -> list["Leaf"]:
        """A leaf for each of the values of one that may be there several times."""
        values = [each for each in (self.value, *self.further) if each]
        return [replace(self, value=each, further=()) for each in values]


@dataclass(frozen=True)
class Group:
    """A node of its own, with its classes; ``least`` and ``most`` say how often it may be there.

    ``filled``: it is sent even as it is. ``when``: as of Leaf.
    """

    path: str
    label: str
    hint: str
    classes: str
    least: int
    most: int
    fields: Sequence["Leaf | Group"]
    filled: bool = False
    when: Sequence[str] = ()
    kind: ClassVar[str] = "group"

    @property
    def required(self) -> bool:
        return self.least > 0


@dataclass(frozen=True)
class Form:
    """``mark`` makes ids of the page; ``needed`` comes first, ``further`` need not be filled in."""

    action: str
    mark: str
    methods: str
    classes: str
    name: str
    needed: Sequence[Leaf | Group]
    further: Sequence[Leaf | Group]
    rehearses: bool = False
