"""Documents of resources whose description is a template: it is written once, and values are put into it anew.

A fleet has thousands of blueprints of a few dozen kinds, and hundreds of actions that differ in limits: resources of
one kind share their templates. Each resource with measured values has templates of its own. A filled document equals a
written one byte for byte, because only names and values take part that every text syntax writes as they are. Rows of
values, such as the samples of a history, are repeated: their text is that between the second and the third row.
"""

from collections.abc import Hashable, Sequence
from functools import partial
from typing import NamedTuple

from pyoxigraph import NamedNode

from linked_fleet_gateway.resources.description import REPEATED, DescriptionTemplate, MeasuredDescription, Values
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.property import Measurement
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription_resource import describe_version
from linked_fleet_rdf.forms import render_graph, write_graph
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import TEXT_TYPES
from linked_fleet_rdf.templates import Document, Markers, RowTemplate, Template, TemplateCache
from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_state.observation import Observation

MAX_TEMPLATES = 512
MAX_CHARACTERS = 8 * 1024 * 1024
"""Limits of the templates of all kinds."""
MAX_RENDERINGS = 4096


class Versions(NamedTuple):
    """The versions that a message states (``describe_version``)."""

    version: str
    event_id: str
    previous: str | None


def is_measured(resource: Resource, media_type: str) -> bool:
    """Return True if a ``Rendering`` is possible. Binary syntaxes are excluded, because they store text lengths."""
    description = resource.describe
    return isinstance(description, MeasuredDescription) and bool(description.samplers) and media_type in TEXT_TYPES


class Rendering:
    """A measured resource in one media type under one base URL, valid while its facts do not change."""

    def __init__(self, resource: Resource, media_type: str, base: str) -> None:
        assert isinstance(resource.describe, MeasuredDescription)
        self._description = resource.describe
        self._resource, self._media_type, self._base = resource, media_type, base
        self._form: Hashable = None
        self._values = 0
        self._template = Template([""], ())

    def render_current(self) -> bytes:
        """Return the document with the present values. Raises WriteError if the syntax cannot express it."""
        return self.render(self._description.measure())

    def render_observations(self, observations: Sequence[Observation], versions: Versions | None = None) -> bytes:
        """Return the document with the observations of a reading. Raises WriteError."""
        return self.render(self._description.measurements(observations), versions)

    def render(self, measurements: Sequence[Measurement], versions: Versions | None = None) -> bytes:
        """Return the document with these values. Raises WriteError."""
        form, texts = self._description.values(measurements)
        first = len(texts)
        if versions is not None:
            texts += (each for each in versions if each is not None)
        if form != self._form or len(texts) != self._values:
            self._template = self._compile(measurements, first, len(texts) - first)
            self._form, self._values = form, len(texts)
        return self._template.fill(texts)

    def _compile(self, measurements: Sequence[Measurement], first: int, versions: int) -> Template:
        """Return the template; ``first``: index of the first version."""
        marks, graph = Markers(), Graph()
        self._description.describe_marked(graph, measurements, marks)
        self._resource.add_interaction_model(graph, self._base)
        iri = self._base + self._resource.path
        if versions:
            describe_version(graph, NamedNode(iri), *map(marks.text, range(first, first + versions)))
        return marks.template(render_graph(graph, self._media_type, PREFIXES, base=iri).content.decode())


class Templates:
    """The templates of one gateway: of kinds by form, media type and base URL, and of measured resources.

    They are compiled again when the facts of a measured resource change. All are bounded; the oldest are dropped first.
    """

    def __init__(
        self,
        max_templates: int = MAX_TEMPLATES,
        max_characters: int = MAX_CHARACTERS,
        max_renderings: int = MAX_RENDERINGS,
    ) -> None:
        self.of_kinds = TemplateCache(max_templates, max_characters)
        """None for a kind whose rows are not written alike."""
        self._most = max_renderings
        self._renderings: dict[tuple[str, str, str], tuple[object, Rendering]] = {}

    def rendering(self, resource: Resource, media_type: str, base: str) -> Rendering | None:
        """Return the rendering of measured values; None without any, or if the media type has none."""
        if not is_measured(resource, media_type):
            return None
        key, facts = (base, resource.path, media_type), resource.source.facts()
        kept = self._renderings.get(key)
        if kept is None or kept[0] != facts:
            self._renderings.pop(key, None)
            while len(self._renderings) >= self._most:
                del self._renderings[next(iter(self._renderings))]
            kept = self._renderings[key] = (facts, Rendering(resource, media_type, base))
        return kept[1]

    def document(self, resource: Resource, media_type: str, base: str) -> Document | None:
        """Return the document of a resource by the template of its kind. Raises WriteError.

        Returns None if it has no kind, or must be written.
        """
        kind, values = _kind(resource, media_type)
        if kind is None or values is None:
            return None
        form, texts = values
        key = (form, media_type, base)
        template = self.of_kinds.get(key)
        if template is None and key not in self.of_kinds:
            template = _compile(resource, kind, len(texts), media_type, base)
            self.of_kinds.keep(key, template)
        return None if template is None else Document(template.fill(texts), template, texts)

    def is_known(self, resource: Resource, media_type: str, base: str) -> bool:
        """Return True if there is a template of the resource's kind, so that its document takes little time."""
        _, values = _kind(resource, media_type)
        return values is not None and self.of_kinds.get((values[0], media_type, base)) is not None

    def forget_robot(self, robot: str) -> None:
        """Drop the templates of the measured resources of a robot that was removed."""
        for key in [key for key in self._renderings if robot_of(key[1]) == robot]:
            del self._renderings[key]

    def __len__(self) -> int:
        return len(self.of_kinds) + len(self._renderings)


def _kind(resource: Resource, media_type: str) -> tuple[DescriptionTemplate | None, Values | None]:
    kind = resource.template if media_type in TEXT_TYPES else None
    return kind, None if kind is None else kind.values()


def _compile(resource: Resource, kind: DescriptionTemplate, values: int, media_type: str, base: str) -> Template | None:
    """Return the template of a kind; ``values``: the number of values, rows included.

    Returns None if the rows of such documents are not written alike.
    """
    marked, rows = partial(_marked, resource, kind, media_type, base), kind.rows
    if rows is None or rows.count < REPEATED:
        return marked(0 if rows is None else rows.count)
    first, width = values - len(rows.texts), len(rows.datatypes)
    try:
        found, more = (RowTemplate(marked(count), first, width) for count in (REPEATED, REPEATED + 1))
    except ValueError:
        return None
    return found if found.has_same_text(more) else None


def _marked(resource: Resource, kind: DescriptionTemplate, media_type: str, base: str, rows: int) -> Template:
    """Return the template with places for so many rows."""
    marks, graph = Markers(), Graph()
    path = kind.describe_marked(graph, resource.path, marks, rows)
    resource.add_interaction_model(graph, base, path)
    return marks.template(write_graph(graph, media_type, PREFIXES, base=base + path).decode())
