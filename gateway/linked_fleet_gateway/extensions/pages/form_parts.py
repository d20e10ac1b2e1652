"""The parts of a form: values, nested nodes, and the form itself, as the template renders them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from linked_fleet_gateway.extensions.pages.languages import message, say, translated
from linked_fleet_gateway.extensions.pages.texts import clean
from linked_fleet_gateway.faces import Right

_GRAPHS = frozenset({"turtle"})
_FORBIDDEN = {
    Right.ACT: message("You have no right to move this robot."),
    Right.STOP: message("You have no right to stop this robot."),
    Right.RESET: message("You have no right to let this robot move again."),
    Right.ADMIN: message("You have no right to change this."),
    Right.SUBSCRIBE: message("You have no right to have messages sent or rules followed."),
}
_OFFLINE = message("The robot is offline: nothing can be sent to it.")
_CONTROLLED = frozenset({Right.ACT, Right.RESET, Right.ADMIN})
"""Rights for what the holder of a control lease alone may do: motions and settings."""


@dataclass(frozen=True)
class Leaf:
    """One value. ``input``: the type of its element. ``limits``: JSON for `scripts/src/limits.js`, or empty.

    ``when``: the types of its node to which it applies, empty for all. ``editor``: the language of a text, for
    `scripts/src/editor.js`. ``variable``: whether ``?name`` stands for a node that names a variable. ``further``: the
    values after the first. ``member``: its name in the JSON form, in that of the next group above which has one.
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
    member: str = ""
    kind: ClassVar[str] = "leaf"

    @property
    def term_kind(self) -> str:
        """The kind of term that `scripts/src/form.js` makes of the value."""
        return (
            self.editor if self.editor in _GRAPHS else "variable" if self.variable else "iri" if self.iri else "literal"
        )

    @property
    def repeated(self) -> list["Leaf"]:
        """Return a leaf for each value of a repeatable one."""
        values = [each for each in (self.value, *self.further) if each]
        return [replace(self, value=each, further=()) for each in values]


@dataclass(frozen=True)
class Group:
    """A nested node with its classes. ``least`` and ``most``: how often it may occur.

    ``filled``: it is sent even if unchanged. ``when``, ``member``: as in Leaf.
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
    member: str = ""
    kind: ClassVar[str] = "group"

    @property
    def required(self) -> bool:
        return self.least > 0


@dataclass(frozen=True)
class Form:
    """A form.

    ``mark`` is a prefix for ids on the page, ``needed`` are required fields, ``further`` optional ones. ``right``: that
    which its request needs.
    """

    action: str
    mark: str
    methods: str
    classes: str
    name: str
    needed: Sequence[Leaf | Group]
    further: Sequence[Leaf | Group]
    right: Right
    rehearses: bool = False

    def refusal(self, rights: Collection[str] | None, holder: str, *, offline: bool) -> str:
        """Return why its request would be refused now; empty if nothing is known against it.

        ``rights``: those of the reader, None for all. ``offline``: whether it is sent to a robot that is offline.
        ``holder``: who has control of the robot, if anybody. `scripts/src/presence.js` says the same, and later.
        """
        if rights is not None and self.right.value not in rights:
            return translated(_FORBIDDEN.get(self.right, message("You have no right to do this.")))
        if offline:
            return translated(_OFFLINE)
        held = holder and self.right in _CONTROLLED
        return say("{holder} has control of the robot: this would be refused.", holder=clean(holder)) if held else ""
