"""Declarations of components: properties, actions and events with their schemas (PROTOCOL.md)."""

from typing import Annotated

from msgspec import Meta, Struct, field

from linked_fleet_agent.wire.messages import Name
from linked_fleet_agent.wire.schema import Iri, Prose, Schema, Title

MAX_COMPONENTS, MAX_PROPERTIES, MAX_ACTIONS, MAX_EVENTS = 64, 256, 128, 128
BASE = "base"
"""The word in ``moves`` for the base of a robot, which is no joint."""

Rate = Annotated[float, Meta(gt=0, le=100)]
Duration = Annotated[float, Meta(gt=0, le=86_400)]


class Property(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """A value of a component. One that is ``writable`` is set by ``Operate``."""

    schema: Schema
    writable: bool = False


class StreamLimits(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The largest age of the samples of a stream, and what their absence means.

    A sample is dropped if the robot time that its sender saw last is older than ``age_s``. Without a sample that could
    be used for ``silence_s`` the action comes to rest and goes on; without any sample for ``end_s`` it ends.
    """

    age_s: Annotated[float, Meta(gt=0, le=5)] = 0.15
    silence_s: Annotated[float, Meta(gt=0, le=5)] = 0.2
    end_s: Annotated[float, Meta(gt=0, le=60)] = 2.0


class Action(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """An action of a component.

    ``moves`` names joints or ``base``; an action that moves something is a motion. ``duration_s`` is how long it may
    take, ``stop_s`` how long it may go on after it was cancelled. One that ``rehearses`` can be asked what it would do.
    One with a ``stream`` can also be opened as a stream, whose samples are further inputs. One that ``resumes`` goes on
    when its agent ends, and the next run of the agent tells how it ends; it moves nothing.
    """

    title: Title = ""
    description: Prose = ""
    semantic_type: Iri = field(default="", name="@type")
    input: Schema | None = None
    feedback: Schema | None = None
    result: Schema | None = None
    moves: Annotated[tuple[Name, ...], Meta(max_length=256)] = ()
    duration_s: Duration = 60.0
    stop_s: Annotated[float, Meta(gt=0, le=30)] = 1.0
    rehearses: bool = False
    stream: StreamLimits | None = None
    resumes: bool = False


class Event(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Something that happens to a component; ``data`` is what is said about it."""

    title: Title = ""
    description: Prose = ""
    semantic_type: Iri = field(default="", name="@type")
    data: Schema | None = None


class Component(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The declaration of a component.

    ``semantic_type`` is the IRI of its kind, empty for one that has none; ``link`` is where it is mounted. Its values
    are published at ``rate_hz`` at most, and unknown when nothing was measured for ``stale_s``.
    """

    name: Name
    title: Title = ""
    description: Prose = ""
    semantic_type: Iri = field(default="", name="@type")
    link: Annotated[str, Meta(max_length=128)] = ""
    rate_hz: Rate = 10.0
    stale_s: Annotated[float, Meta(ge=0.1, le=3600)] = 5.0
    properties: Annotated[dict[Name, Property], Meta(max_length=MAX_PROPERTIES)] = {}
    actions: Annotated[dict[Name, Action], Meta(max_length=MAX_ACTIONS)] = {}
    events: Annotated[dict[Name, Event], Meta(max_length=MAX_EVENTS)] = {}
