"""The base class of components, and what marks their values, actions and events."""

from collections.abc import Callable, Iterable, Sequence
from types import NoneType
from typing import Any, ClassVar, Generic, Literal, NamedTuple, Self, TypeVar, overload

import msgspec

from linked_fleet_agent.wire.declaration import StreamLimits

C = TypeVar("C", bound="Component")
T = TypeVar("T")
Method = TypeVar("Method", bound=Callable[..., Any])
Moves = Sequence[str] | Callable[[Any], Sequence[str]]
Rename = Literal["", "camel"]
Emit = Callable[[str, bytes | None], None]


class Component:
    """A part of a robot that has values, actions and events: a gripper, a battery, a tool, a task.

    ``kind`` is the IRI of its class in a vocabulary. Its values are read up to ``rate_hz`` times a second, all in one
    thread; of one that is not ``blocking`` they are read on the event loop of the agent, and must be at hand. They are
    unknown if nothing could be read for ``stale_s``. Each raises what it likes if it cannot be read. With
    ``rename="camel"`` the fleet gets to know ``tool_output`` as ``toolOutput``.
    """

    name: str = ""
    """The name in the fleet; the name of the class in lower case by default."""
    title: str = ""
    link: str = ""
    """The link of the robot where it is mounted, if any."""
    kind: ClassVar[str] = ""
    rate_hz: ClassVar[float] = 10.0
    stale_s: ClassVar[float] = 5.0
    blocking: ClassVar[bool] = True
    rename: ClassVar[Rename] = ""
    prevents_motion: str = ""
    """A sentence why the robot must not move now, such as a protective stop; empty if it may.

    While there is one, the agent ends all that moves and refuses motions. Read in each tick, so it must be at hand.
    """
    emit: Emit | None = None
    """Takes events while an agent runs this component. For the agent."""

    def on_tick(self, now_s: float) -> None:
        """Do what is to be done in each tick of the agent, on its event loop, at ``now_s`` of its monotonic clock."""

    def unfinished(self) -> Iterable[tuple[str, str]]:
        """Return runs that an earlier agent has begun and that go on, by the name of the action and their id.

        Asked in each tick, on its event loop; each is named once. The action must ``resume``.
        """
        return ()

    def on_halt(self) -> None:
        """Bring everything to rest that no action ends, because the agent ends or the robot has a fault."""

    def __init_subclass__(
        cls,
        *,
        kind: str | None = None,
        rate_hz: float | None = None,
        stale_s: float | None = None,
        blocking: bool | None = None,
        rename: Rename | None = None,
    ) -> None:
        super().__init_subclass__()
        said = {"kind": kind, "rate_hz": rate_hz, "stale_s": stale_s, "blocking": blocking, "rename": rename}
        for attribute, given in said.items():
            if given is not None:
                setattr(cls, attribute, given)

    @classmethod
    def name_of(cls, member: str) -> str:
        """Return the name of a value, action or event in the fleet."""
        if cls.rename != "camel":
            return member
        first, *others = member.split("_")
        return first + "".join(each[:1].upper() + each[1:] for each in others)


class value(Generic[C, T]):  # noqa: N801 - a decorator, as ``property``
    """Makes a value of a method without arguments, as ``property`` does. Its annotation is its schema.

    With ``@NAME.setter`` it can be set.
    """

    def __init__(self, read: Callable[[C], T]) -> None:
        self.read = read
        self.set: Callable[[C, T], None] | None = None

    def setter(self, set_: Callable[[C, T], None]) -> Self:
        """Mark the method that sets the value. It may have any name."""
        self.set = set_
        return self

    @overload
    def __get__(self, component: None, owner: type[C]) -> Self: ...
    @overload
    def __get__(self, component: C, owner: type[C]) -> T: ...
    def __get__(self, component: C | None, owner: type[C]) -> Self | T:
        return self if component is None else self.read(component)

    def __set__(self, component: C, given: T) -> None:
        if self.set is None:
            raise AttributeError("this value cannot be set")
        self.set(component, given)


class ActionOptions(NamedTuple):
    """The options of an action, which mark its method."""

    moves: Moves
    duration_s: float
    stop_s: float
    title: str
    kind: str
    rehearse: Callable[..., float] | None
    takes_over: bool = False
    stream: StreamLimits | None = None
    resume: Callable[..., Any] | None = None


def action(
    *,
    moves: Moves = (),
    duration_s: float = 60.0,
    stop_s: float = 1.0,
    title: str = "",
    kind: str = "",
    rehearse: Callable[..., float] | None = None,
    takes_over: bool = False,
    stream: StreamLimits | None = None,
    resume: Callable[..., Any] | None = None,
) -> Callable[[Method], Method]:
    """Mark a method as an action. The annotations of its parameters and of what it returns are its schemas.

    A parameter ``call`` gets the ``Call``. An ``async`` method runs on the event loop, where it must not block, and any
    other in a thread. ``moves`` names the joints that it moves, or ``BASE``, and makes it a motion. It may take
    ``duration_s``, and ``stop_s`` after it was cancelled. ``rehearse`` has the same parameters without ``call``; it
    returns how long the action would take, or raises ValueError with the reason why it would not be carried out.

    A run that ``takes_over`` begins while an earlier run of the same action is moving, which is told so
    (``Call.replaced``): it ends once the newer one has taken over, or else brings to rest what it moves.

    With ``stream`` a run can be opened as a stream: ``call.stream`` then yields further inputs, and ``duration_s`` does
    not end the run. The method is ``async``, and its parameters have defaults.

    A run goes on after the end of the agent if there is ``resume``, an ``async`` method that takes ``call`` and waits
    for its end: the next agent awaits it for each run that the component has ``unfinished``. Such an action moves
    nothing.
    """

    def mark(method: Method) -> Method:
        options = ActionOptions(moves, duration_s, stop_s, title, kind, rehearse, takes_over, stream, resume)
        setattr(method, OPTIONS, options)
        return method

    return mark


OPTIONS = "__linked_fleet_action__"


class event(Generic[T]):  # noqa: N801 - a marker, as ``value``
    """An event of a component: an attribute of its class, which is called with the data when it happens.

    May be called from any thread. Events of a component that no agent runs are lost.
    """

    def __init__(self, data: type[T] | None = None, *, title: str = "", description: str = "", kind: str = "") -> None:
        self.data, self.title, self.description, self.kind = data or NoneType, title, description, kind
        self.name = ""

    def __set_name__(self, owner: type[Component], name: str) -> None:
        self.name = name

    @overload
    def __get__(self, component: None, owner: type[Component]) -> Self: ...
    @overload
    def __get__(self, component: Component, owner: type[Component]) -> Callable[..., None]: ...
    def __get__(self, component: Component | None, owner: type[Component]) -> Self | Callable[..., None]:
        if component is None:
            return self

        def happen(data: T | None = None) -> None:
            if component.emit is not None:
                component.emit(
                    component.name_of(self.name), None if self.data is NoneType else msgspec.json.encode(data)
                )

        return happen
