"""Pages from the triples of resources: the common frame, and the view of each kind."""

import logging
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pyoxigraph import NamedNode, Triple

from linked_fleet_base.contributions import present
from linked_fleet_gateway.extensions.pages import action_views, texts
from linked_fleet_gateway.extensions.pages import thing_views as things
from linked_fleet_gateway.extensions.pages.fleet_views import fleet
from linked_fleet_gateway.extensions.pages.languages import known, say
from linked_fleet_gateway.extensions.pages.thing_views import DescribedSubject, describe_subject
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Row
from linked_fleet_gateway.extensions.pages.views import LF, Part, Place, added_views, files_of, places
from linked_fleet_gateway.extensions.pages.vocabulary_view import vocabulary
from linked_fleet_gateway.faces import PageContext, Resource, lease_path, offers_at
from linked_fleet_rdf.serialise import RDF_TYPES
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, OWL, PROV, RDF, ROS, SOSA, XHV

log = logging.getLogger(__name__)

# The first type of a resource found in this order decides its kind.
_KINDS: Mapping[NamedNode, tuple[str, Callable[[Facts, NamedNode], Part]]] = {
    LF.Fleet: ("fleet", fleet),
    LF.InvocationList: ("invocations", action_views.invocations),
    OWL.Ontology: ("vocabulary", vocabulary),
    LF.Robot: ("robot", things.robot),
    LF.Joint: ("joint", things.joint),
    ROS.Link: ("link", things.link),
    LF.Invocation: ("invocation", action_views.invocation),
    HYBRIT.Action: ("action", action_views.action),
    LF.JointState: ("joint_state", things.joint_state),
    LF.Annotations: ("annotations", things.annotations),
    HYBRIT.Property: ("property", things.property_),
    HYBRIT.Subscription: ("subscription", action_views.subscription),
    LF.ControlLease: ("lease", action_views.lease),
}
# Types that all resources of a kind have, so that a heading need not name them.
_PLAIN_TYPES = frozenset(
    {HYBRIT.RoboticThing, HYBRIT.Property, HYBRIT.Action, HYBRIT.AsynchronousAction, LF.Joint, PROV.Activity}
    | {LDP.Container, LDP.BasicContainer, LDP.RDFSource}
    | {
        LF.Fleet,
        LF.Audit,
        LF.Directory,
        LF.Invitations,
        LF.People,
        LF.Invocation,
        LF.InvocationList,
        LF.JointState,
        OWL.Ontology,
    }
    | {SOSA.ObservableProperty, SOSA.Actuation}
)
# Predicates that the frame of the page already shows.
_FRAME = frozenset({DCTERMS.title, HYBRIT.blueprint, HYBRIT.subscriptions, XHV.prev, XHV.next})
_NOT_SERVED = frozenset({"actions"})


@dataclass(frozen=True)
class View:
    """A page.

    ``crumbs``: names with IRIs, the last one without. ``stop``: what the Stop button stops, and the IRI of the action.
    ``lease``: the IRI of the control lease of the robot that the page is about, else empty. ``places``: the navigation.
    ``warning``: about the gateway. ``offline``: whether the robot of the page is; ``holder``: who has control of it, if
    anybody. ``scripts``, ``styles``: addresses of those that only this kind of page has. ``for_developers``: links at
    its foot.
    """

    iri: str
    query: str
    documents: Sequence[str]
    offered: Mapping[str, tuple[str, str]]
    root: str
    kind: str
    title: str
    types: Sequence[Link]
    crumbs: Sequence[tuple[str, str]]
    stop: tuple[str, str]
    lease: str
    observable: bool
    blueprint: str
    subscriptions: str
    previous: Sequence[Link]
    following: Sequence[Link]
    more: Mapping[str, Any]
    rows: Sequence[Row]
    others: Sequence[DescribedSubject]
    places: Sequence[Place]
    warning: str
    offline: bool = False
    holder: str = ""
    scripts: Sequence[str] = ()
    styles: Sequence[str] = ()
    for_developers: Sequence[Place] = ()

    @property
    def here(self) -> str:
        """The path of this page, with its query."""
        path = "/" + self._address.removeprefix(self.root)
        return f"{path}?{self.query}" if self.query else path

    @property
    def formats(self) -> list[tuple[str, str, str]]:
        """Name, media type and address of every other representation."""
        address, rest = self._address, f"&{self.query}" if self.query else ""
        offered = {*RDF_TYPES, *self.documents}
        return [
            (name, media_type, f"{address}?as={key}{rest}")
            for key, (name, media_type) in self.offered.items()
            if media_type in offered
        ]

    @property
    def curl(self) -> str:
        return f"curl -H 'Accept: text/turtle' {shlex.quote(self._address + (f'?{self.query}' if self.query else ''))}"

    @property
    def _address(self) -> str:
        return self.iri.partition("?")[0]  # the IRI of some resources has the query


def view_of(
    resource: Resource,
    triples: Sequence[Triple],
    base: str,
    formats: Mapping[str, tuple[str, str]],
    context: PageContext,
) -> View:
    """Return the view of a resource; ``base`` is scheme and authority, without a slash at its end."""
    iri, facts = NamedNode(base + resource.path), Facts(triples, base + "/", context.query)
    kind, part, files = _kind(facts, iri)
    subscriptions = facts.one(iri, HYBRIT.subscriptions) if context.links_subscriptions else None
    robot = resource.source.robot
    title = part.title or _title(resource, facts, iri)
    return View(
        iri=iri.value,
        query=context.query,
        documents=tuple(resource.documents),
        offered=formats,
        root=facts.root,
        kind=kind,
        title=title,
        types=[
            facts.term(each)
            for each in facts.all(iri, RDF.type)
            if isinstance(each, NamedNode) and each not in _PLAIN_TYPES
        ],
        crumbs=_crumbs(resource, facts, title),
        stop=_stop(resource, facts.root),
        lease="" if robot is None else facts.root + lease_path(robot.name)[1:],
        observable=resource.observable,
        blueprint=_blueprint(facts, iri),
        subscriptions=subscriptions.value if isinstance(subscriptions, NamedNode) else "",
        previous=_links(facts, iri, XHV.prev),
        following=_links(facts, iri, XHV.next),
        more=part.more,
        rows=facts.rows(iri, without=_FRAME | part.shown),
        others=[
            describe_subject(facts, each) for each in facts.outline.headings if each != iri and each not in part.done
        ],
        places=places(resource.path, context.reader.restricted_paths, root=facts.root),
        warning=context.warning,
        offline=robot is not None and not robot.online,
        holder="" if robot is None or robot.lease is None else robot.lease.holder,
        scripts=[each for each in files if each.endswith(".js")],
        styles=[each for each in files if each.endswith(".css")],
        for_developers=places(resource.path, context.reader.restricted_paths, root=facts.root, for_developers=True),
    )


def _title(resource: Resource, facts: Facts, iri: NamedNode) -> str:
    """Return the title, translated unless it may be that of a user's thing."""
    title = texts.readable_title(facts.text(iri, DCTERMS.title) or texts.clean(resource.title), facts.root)
    segments = texts.segments(resource.path, "/")
    own = not segments or (segments[0] in present().at_root and not texts.is_id(segments[-1]))
    given = own or texts.is_gateway_segment(segments, len(segments) - 1)
    return known(title) if given else title


def _kind(facts: Facts, iri: NamedNode) -> tuple[str, Part, Sequence[str]]:
    """Return the kind of page, what its view shows, and the addresses of its files."""
    if action_views.is_subscriptions(facts, iri):
        return "subscriptions", action_views.subscriptions(facts, iri), ()
    types = facts.all(iri, RDF.type)
    for view in added_views():
        if view.type in types:
            try:
                return view.kind, view.read(facts, iri), files_of(view)
            except Exception:
                # The boundary: what an extension's view cannot read is shown as triples.
                log.exception("the view %s cannot show %s", view.kind, iri.value)
                return "document", Part(), ()
    for type_, (kind, read) in _KINDS.items():
        if type_ in types:
            return kind, read(facts, iri), ()
    return "document", Part(), ()


def _links(facts: Facts, iri: NamedNode, predicate: NamedNode) -> list[Link]:
    return [facts.link(each) for each in facts.nodes(iri, predicate)]


def _blueprint(facts: Facts, iri: NamedNode) -> str:
    """Return the document of the blueprint, not the shape in it."""
    own = [each.value for each in facts.nodes(iri, HYBRIT.blueprint)]
    return next((each for each in own if each.startswith(facts.root)), "")


def _crumbs(resource: Resource, facts: Facts, title: str) -> list[tuple[str, str]]:
    """Return the links from the fleet to this resource, by their titles where these are known.

    Path prefixes that are no resources are left out.
    """
    segments, robot = [each for each in resource.path.split("/") if each], resource.source.robot
    crumbs = [(say("Fleet"), facts.root)]
    for depth, segment in enumerate(segments):
        is_robot = depth == 0 and segment not in present().at_root
        address = facts.root + "/".join(segments[: depth + 1]) + ("/" if is_robot else "")
        if segment in _NOT_SERVED:
            continue
        given = facts.text(NamedNode(address), DCTERMS.title) if texts.is_id(segment) or is_robot else ""
        if is_robot and robot is not None:
            given = given or texts.clean(robot.title)
        crumbs.append((given or texts.step(segments, depth), address))
    last = segments[-1] if segments else ""
    return [*crumbs[:-1], (title if title and texts.is_id(last) else crumbs[-1][0], "")]


def _stop(resource: Resource, root: str) -> tuple[str, str]:
    """Return the robot's own stop action on pages below the robot, if it has one; else that of the whole fleet."""
    head, robot = resource.path[1:].partition("/")[0], resource.source.robot
    able = robot is None or any(each.definition.iri == LF.StopRobot for each in offers_at(robot))
    if head and head not in present().at_root and able:
        return texts.segment_name(head, 0), f"{root}{head}/actions/stop"
    return say("all"), f"{root}actions/stopAll"
