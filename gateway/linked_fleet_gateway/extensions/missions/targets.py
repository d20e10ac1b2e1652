"""The actions that the steps of a mission invoke: found in the tree, checked with their bodies, and invoked."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from urllib.parse import unquote

from pyoxigraph import NamedNode, Triple

from linked_fleet_gateway.api import Conflict, Core, Invocation, UnprocessableContent, robot_of, thing_at, time_sliced
from linked_fleet_gateway.extensions.missions.findings import Findings
from linked_fleet_gateway.extensions.missions.mission import Invoke, Mission, Variable, walk, walk_paths
from linked_fleet_gateway.extensions.missions.record import Creator, Run
from linked_fleet_gateway.extensions.missions.values import (
    Value,
    is_free,
    json_body,
    known_values,
    rdf_body,
    samples,
    values_in,
    variables_of,
)
from linked_fleet_gateway.extensions.rules.rule_invocation import NoAction, find_action, path_in_fleet, present_identity
from linked_fleet_gateway.extensions.rules.template import triples_of
from linked_fleet_gateway.faces import EVERYBODY, Claims, Identity, Offer, Right, Tree, offers_at
from linked_fleet_gateway.serving import Caller, Identities, robot_time

Values = Mapping[str, tuple[Value, str]]
MOST_NESTED = 8


class RightsEnded(Conflict):
    """The client that runs the mission has lost the right to it."""


@dataclass
class Targets:
    """Finds the actions of steps in the fleet, for the callers that may invoke them. ``missions`` are all, by id."""

    core: Core
    missions: Mapping[str, Mission] = field(default_factory=dict)

    def offer(self, step: Invoke, values: Values, base: str, tree: Tree, caller: Identity) -> Offer:
        """Return the action of a step. Raises UnprocessableContent if there is none, InsufficientScope."""
        if step.action:
            return find_action(tree, self.path(step.action, base), caller)
        iri = str(values[step.of.variable][0]) if isinstance(step.of, Variable) else step.of
        thing = self.path(iri, base)
        found = [each for each in self._actions_of(thing) if each.definition.iri.value == step.kind]
        if not found:
            kind = step.kind.rpartition("#")[2]
            raise NoAction(f"{thing[:200]} has no action of the kind {kind[:100]}.")
        return find_action(tree, found[0].path, caller)

    def path(self, iri: str, base: str) -> str:
        """Return the path of a resource of this fleet. Raises UnprocessableContent for another IRI."""
        path = path_in_fleet(iri, (base, *self.core.public_urls))
        if path is None:
            raise UnprocessableContent(f"{iri[:200]} is no resource of this fleet, whose IRIs begin with {base}/.")
        return path

    def _actions_of(self, thing: str) -> Sequence[Offer]:
        found = thing_at(thing, self.core.robots)
        if found is None:
            raise NoAction(f"{thing[:200]} is neither a robot, nor a joint or component of one.")
        return offers_at(*found)

    def named_robots(self, mission: Mission) -> frozenset[str]:
        """Return the robots that a mission names, in its steps and their bodies.

        A robot that is known is also named under another URL, perhaps one of another gateway of the fleet.
        """
        own = {segment for each in self.core.extensions for segment in each.at_root}
        iris = [each for each in _iris(mission) if each]
        here = {path_in_fleet(each, self.core.public_urls) for each in iris}
        elsewhere = map(robot_of, map(_path_of, iris))
        named = {robot_of(each) for each in here if each is not None} | (set(elsewhere) & self.core.robots.keys())
        return frozenset(each for each in named if each is not None) - own

    def told_of(self, mission: Mission, values: Mapping[str, Value], base: str) -> tuple[str, ...]:
        """Return the robots that an invocation of a mission tells of: those that it names, and those in its values."""
        return tuple(sorted(self.named_robots(mission) | self._given(values.values(), base)))

    def used_robots(self, mission: Mission, values: Iterable[Value], base: str) -> frozenset[str]:
        """Return the robots that a mission, those that it runs, and values of its parameters name."""
        all_ = (mission, *self._nested(mission, ()))
        return self._given(values, base).union(*map(self.named_robots, all_))

    def _given(self, values: Iterable[Value], base: str) -> frozenset[str]:
        paths = (path_in_fleet(each, (base, *self.core.public_urls)) for each in values if isinstance(each, str))
        found = (robot_of(each) for each in paths if each is not None)
        return frozenset(each for each in found if each is not None and each in self.core.robots)

    def possible_robots(self, mission: Mission) -> frozenset[str] | None:
        """Return the robots that a mission may act on, also by missions that it runs; None if that is not known."""
        try:
            all_ = (mission, *self._nested(mission, ()))
        except UnprocessableContent:  # a circle, so it cannot run as it is
            return None
        if any(isinstance(step.of, Variable) for each in all_ for step in invoked(each)):
            return None
        return frozenset().union(*map(self.named_robots, all_))

    def check_nesting(self, path: str, mission: Mission) -> None:
        """Raise UnprocessableContent if a mission would run itself by its steps, or missions are nested too deep."""
        self._nested(mission, (path,))

    def _nested(self, mission: Mission, above: tuple[str, ...]) -> list[Mission]:
        """Return the missions that a mission runs by its steps, at any depth."""
        found = list[Mission]()
        for step in invoked(mission):
            path = self._mission_path(step.action)
            inner = self.missions.get(path.rpartition("/")[2]) if path else None
            if inner is None:
                continue
            if path in above:
                raise UnprocessableContent(f"The mission {inner.title} would run itself; missions have no circles.")
            if len(above) >= MOST_NESTED:
                raise UnprocessableContent(f"Missions run each other at most {MOST_NESTED} deep.")
            found += [inner, *self._nested(inner, (*above, path))]
        return found

    def _mission_path(self, action: str) -> str:
        """Return the path of the mission that an action runs; empty if it is another action."""
        path, end = path_in_fleet(action, self.core.public_urls) or "", "/actions/run"
        return path.removesuffix(end) if path.startswith("/missions/") and path.endswith(end) else ""

    # -- checks -----------------------------------------------------------------------------------------------------

    async def check(self, mission: Mission, base: str, tree: Tree, caller: Identity) -> None:
        """Check all steps for which that is possible before the mission has values. Raises UnprocessableContent,
        InsufficientScope.
        """
        kinds, findings = {each.name: each for each in mission.parameters}, Findings()
        values = samples(mission)
        async for path, step in time_sliced(invoked_at(mission)):
            names = variables_of(step)
            unknown = {name for name in names if name not in kinds or is_free(kinds[name])}
            if isinstance(step.of, Variable) and step.of.variable in unknown:
                continue
            with findings.at(path, step):
                offer = self.offer(step, values, base, tree, caller)
                if not unknown:
                    self.body(step, offer, values, base)
        findings.check()

    async def check_run(self, mission: Mission, values: Values, base: str, tree: Tree, caller: Identity) -> None:
        """Check all steps with the values of a run, but those that need results of other steps. Raises as ``check``.

        Bodies without variables were checked when the mission was written.
        """
        findings = Findings()
        async for path, step in time_sliced(invoked_at(mission)):
            with findings.at(path, step):
                offer = self.offer(step, values, base, tree, caller)
                if (named := variables_of(step)) and named <= values.keys():
                    self.body(step, offer, values, base)
        findings.check()

    def body(self, step: Invoke, offer: Offer, values: Values, base: str) -> None:
        """Check the body of a step by the shape of its action. Raises UnprocessableContent."""
        if not offer.takes_body:
            if step.body or step.triples:
                raise UnprocessableContent(f"{offer.path} takes no body.")
        elif _has_input(step, offer):
            self.core.check_input(offer, base, self.statements(step, offer, values, base))

    def statements(self, step: Invoke, offer: Offer, values: Values, base: str) -> Sequence[Triple]:
        """Return the input of a step; nothing if its action takes none. Raises UnprocessableContent."""
        if not _has_input(step, offer):
            return ()
        if step.triples:
            return rdf_body(step.triples, values, NamedNode(base + offer.path))
        return self.core.statements(offer, base, json_body(step.body or {}, values))

    def robots(self, mission: Mission, values: Values, base: str, tree: Tree, caller: Identity) -> tuple[str, ...]:
        """Return the robots that the steps act on, also those of missions that they run. Raises as ``offer``."""
        offers = [self.offer(each, values, base, tree, caller) for each in invoked(mission)]
        found = {robot for each in offers if (robot := robot_of(each.path)) in self.core.robots}
        nested = (self.named_robots(each) for each in self._nested(mission, ()))
        return tuple(sorted(filter(None, found.union(*nested))))

    # -- invocation -------------------------------------------------------------------------------------------------

    async def invoke(self, id: str, run: Run, path: str, attempt: int, step: Invoke) -> Invocation:
        """Invoke the action of a step, at most once for each attempt, whichever gateways ask. Raises FleetError."""
        identity, values = self.identity(run.creator), known_values(run)
        tree = self.core.live.tree(run.base, identity.visible_robots)
        offer = self.offer(step, values, run.base, tree, identity)
        said = repr((step.triples, step.body, sorted(values.items())))
        caller = Caller(
            run.creator.client,
            lease_token=run.token or run.creator.lease_token,
            # The key cannot equal a client's key, whose characters are all visible.
            idempotency_key=f"\x1fmission {id} {path} {attempt}",
            request_digest=blake2b(said.encode(), digest_size=16).hexdigest(),
            stoppable_robots=identity.view_for(Right.STOP),
            visible_robots=identity.visible_robots,
            rule=f"mission {id}",
            identity=identity,
        )
        statements = self.statements(step, offer, values, run.base)
        return await self.core.invoke(offer, run.base, caller, statements, robot_time(offer.robot))

    def identity(self, creator: Creator) -> Identity:
        """Return the identity that a run acts for now; everybody if authentication is off. Raises RightsEnded."""
        identities: Identities | None = self.core.identities
        if identities is None:
            return EVERYBODY
        found = present_identity(identities, creator.identity, creator.claims)
        if found is None:
            raise RightsEnded("The rights of who runs the mission have ended.")
        return found


def _path_of(iri: str) -> str:
    """Return the path of an IRI under any URL; the root for a text that is none."""
    return "/" + unquote(iri.partition("://")[2].partition("/")[2])


def _has_input(step: Invoke, offer: Offer) -> bool:
    """Return True if a step sends an input, which its action may not need."""
    return offer.takes_body and (bool(step.triples) or step.body is not None or not offer.body_is_optional)


def creator_of(identity: Identity, client: str, lease_token: str = "") -> Creator:
    """Return who runs or orders a mission, as it is kept."""
    claims = identity.credential if isinstance(identity.credential, Claims) else None
    return Creator(client, identity.name, claims, lease_token)


def invoked(mission: Mission) -> Iterable[Invoke]:
    """Yield the steps of a mission that invoke actions."""
    return (each for each, _ in walk(mission.step) if isinstance(each, Invoke))


def invoked_at(mission: Mission) -> Iterable[tuple[str, Invoke]]:
    """Yield the steps of a mission that invoke actions, with their paths."""
    return ((path, each) for path, each in walk_paths(mission.step) if isinstance(each, Invoke))


def _iris(mission: Mission) -> Iterable[str]:
    """Yield the IRIs that the steps of a mission and their bodies name."""
    for step in invoked(mission):
        yield step.action
        yield step.of if isinstance(step.of, str) else ""
        yield from (each for each in values_in(step.body) if isinstance(each, str))
        yield from (each.object.value for each in triples_of(step.triples) if isinstance(each.object, NamedNode))
