"""Rules at two gateways with one Redis, a robot played by the test and one that rules move."""

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import httpx
import pyshacl
import pytest
import rdflib
from rdflib import URIRef

from browser import HYBRIT, LDP, LF, SH, Browser, Page
from gateway_group import Gateway, Hub, gateway, gateways, hub
from linked_fleet_gateway.extensions.query.messages import QueryRequest
from linked_fleet_gateway.extensions.query.process import Feed, QueryProcess
from linked_fleet_gateway.extensions.query.turns import AT_ONCE, FairTurns, QueryTooCostly, TooManyQueries
from linked_fleet_gateway.extensions.rules.engine import Engine, Evaluation
from linked_fleet_gateway.extensions.rules.rule import Rule, RuleRecord
from linked_fleet_gateway.extensions.rules.service import Rules
from linked_fleet_gateway.extensions.rules.store import Changed, RuleStore
from receivers import receiving
from redis_servers import Servers, single
from rules_client import BEGIN, BY_SIDE, TO_TARGET, TURTLE, a_rule, container, fired, firings, post, posted, put, sides
from running import eventually, process
from small_fleet import live

pytestmark = pytest.mark.virtual


@dataclass
class Scene:
    """``hub`` has the robot that the test plays; ``rotate`` is the action of the other's last joint."""

    memory: Servers
    hub: Hub
    one: Gateway
    other: Gateway
    rotate: str

    def turn(self, angle: float) -> None:
        self.hub.steps = round(angle * 1000)
        self.hub.repeat()

    def rule(self, more: str = BY_SIDE, body: str = TO_TARGET, action: str = "") -> str:
        """Create a rule while the joint is down."""
        self.turn(0.5)
        eventually(lambda: '"0.5"' in self.one.get(self.one.rotation).text, "down")
        rule = posted(self.one.browser, a_rule(sides(self.one.joint), action or self.rotate, body, more))
        eventually(lambda: self.one.browser.page(rule).one(LF.state) == LF.active, "evaluated")
        return rule

    def invocations(self) -> int:
        page = self.one.browser.page(self.rotate)
        return len(list(self.one.browser.page(str(page.one(LF.invocations))).graph.objects(None, LDP.contains)))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        stack.enter_context(process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for each in (one, other):
            live(each.browser, "ur5")
        wrist = one.browser.part("ur5", "wrist_3_joint")
        yield Scene(memory, centre, one, other, one.browser.action(wrist, LF.Rotate))


@pytest.fixture(autouse=True)
def nothing_left(request: pytest.FixtureRequest) -> Iterator[None]:
    """Remove rules, so that none affects another test."""
    yield
    if "scene" in request.fixturenames:
        browser: Browser = request.getfixturevalue("scene").one.browser
        for rule in browser.page(container(browser)).graph.objects(None, LDP.contains):
            assert browser.http.delete(str(rule)).status_code == 204


def test_a_rule_fires_each_time_that_its_condition_starts_to_hold(scene: Scene) -> None:
    rule, before = scene.rule(), scene.invocations()
    scene.turn(1.5)
    assert fired(scene.one.browser, rule, 1) == [("accepted", "up")]
    scene.turn(1.6)  # it continues to hold
    scene.turn(0.4)
    assert fired(scene.one.browser, rule, 2)[1:] == [("accepted", "down")]
    scene.turn(1.2)
    assert fired(scene.one.browser, rule, 3)[2:] == [("accepted", "up")]
    assert scene.invocations() == before + 3
    here = scene.other.here(rule)
    assert [state for state, _ in fired(scene.other.browser, here, 3)] == ["accepted"] * 3


def test_a_firing_links_its_invocation(scene: Scene) -> None:
    rule, browser = scene.rule(), scene.one.browser
    scene.turn(1.5)
    fired(browser, rule, 1)
    invocation = browser.page(str(browser.page(f"{rule}/firings/1").one(LF.invocation)))
    assert '"0.15"' in invocation.response.text


def test_a_firing_within_the_interval_is_suppressed_for_good(scene: Scene) -> None:
    rule = scene.rule('lf:minimumInterval 3600 ; lf:toldApartBy "side"')
    scene.turn(1.5)
    fired(scene.one.browser, rule, 1)
    scene.turn(0.5)
    assert fired(scene.one.browser, rule, 2) == [("accepted", "up"), ("suppressed", "down")]
    scene.turn(1.5)
    eventually(lambda: str(scene.one.browser.page(rule).one(LF.suppressions)) == "2", "counted")
    assert len(firings(scene.one.browser, rule)) == 2


def test_an_answer_that_goes_too_soon_does_not_fire(scene: Scene) -> None:
    """It has to be there for the time that the rule says, each time anew."""
    rule = scene.rule('lf:holdsFor 5 ; lf:toldApartBy "side"')
    assert str(scene.one.browser.page(rule).one(LF.holdsFor)) == "5.0"
    scene.turn(1.5)
    time.sleep(3)
    scene.turn(0.5)
    begun_s = time.monotonic()
    assert fired(scene.one.browser, rule, 1) == [("accepted", "down")]
    assert time.monotonic() - begun_s >= 5
    scene.turn(1.5)
    assert fired(scene.one.browser, rule, 2)[1:] == [("accepted", "up")]


def test_a_refused_action_is_recorded_in_the_firing(scene: Scene) -> None:
    rule = scene.rule(body="vom:numericalValue 99 ; vom:unit unit:RAD")
    scene.turn(1.5)
    assert fired(scene.one.browser, rule, 1) == [("failed", "up")]
    reason = str(scene.one.browser.page(rule + "/firings/1").one(LF.reason))
    assert reason.startswith("422") and "shape" in reason


def test_the_action_may_come_from_the_condition(scene: Scene) -> None:
    condition = sides(scene.one.joint).replace("SELECT ?side", f"SELECT (<{scene.rotate}> AS ?action) ?side")
    scene.turn(0.5)
    text = a_rule(condition, '[ lf:variable "action" ]', TO_TARGET, BY_SIDE)
    rule = posted(scene.one.browser, text)
    eventually(lambda: scene.one.browser.page(rule).one(LF.state) == LF.active, "evaluated")
    scene.turn(1.5)
    assert fired(scene.one.browser, rule, 1) == [("accepted", "up")]


@pytest.mark.parametrize("scheme", ["http", "file"])
def test_an_action_elsewhere_is_refused_by_the_firing_and_asked_of_nobody(scene: Scene, scheme: str) -> None:
    with receiving() as elsewhere:
        iri = elsewhere.url() if scheme == "http" else "file:///etc/passwd"
        condition = sides(scene.one.joint).replace("SELECT ?side", f'SELECT (IRI("{iri}") AS ?action) ?side')
        scene.turn(0.5)
        rule = posted(scene.one.browser, a_rule(condition, '[ lf:variable "action" ]', TO_TARGET, BY_SIDE))
        eventually(lambda: scene.one.browser.page(rule).one(LF.state) == LF.active, "evaluated")
        scene.turn(1.5)
        assert fired(scene.one.browser, rule, 1) == [("failed", "up")]
        reason = str(scene.one.browser.page(rule + "/firings/1").one(LF.reason))
        assert iri in reason and "not an action of this fleet" in reason and "nothing was requested" in reason
        assert elsewhere.connections == 0


def test_an_action_is_named_under_any_public_url_of_the_fleet(scene: Scene) -> None:
    other = str(httpx.URL(scene.rotate).copy_with(host="localhost"))
    assert scene.one.get(other).status_code == 200
    rule = scene.rule(action=other)
    # Either gateway may evaluate the rules, and only this one is known as localhost.
    condition = sides(scene.one.joint).replace("SELECT ?side", f"SELECT (<{scene.rotate}> AS ?action) ?side")
    bound = posted(scene.one.browser, a_rule(condition, '[ lf:variable "action" ]', TO_TARGET, BY_SIDE))
    eventually(lambda: scene.one.browser.page(bound).one(LF.state) == LF.active, "evaluated")
    scene.turn(1.5)
    for each in (rule, bound):
        assert fired(scene.one.browser, each, 1) == [("accepted", "up")]


def test_stopping_all_robots_disables_rules_that_move_them(scene: Scene) -> None:
    moves, stops = scene.rule(), scene.rule(body="", action=scene.one.browser.action(ur5(scene), LF.StopRobot))
    stop_all = scene.one.browser.action(scene.one.browser.page(scene.one.browser.root), LF.StopAll)
    assert scene.other.browser.http.post(scene.other.here(stop_all)).status_code == 204
    page = eventually(lambda: disabled(scene.one.browser, moves), "disabled")
    assert "stopped" in str(page.graph.value(page.iri, LF.reason))
    scene.turn(1.5)
    assert fired(scene.one.browser, stops, 1) == [("accepted", "up")]
    assert firings(scene.one.browser, moves) == []
    assert scene.one.browser.http.delete(stops).status_code == 204  # which would come in between
    assert put(scene.one.browser, moves, "lf:enabled false", "lf:enabled true").status_code == 204
    eventually(lambda: scene.one.browser.page(moves).one(LF.state) == LF.active, "enabled")
    scene.turn(0.5)
    assert fired(scene.one.browser, moves, 1) == [("accepted", "down")]


def test_a_rule_that_is_written_meanwhile_is_replaced_unless_the_client_sets_a_condition(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For example if somebody stops its robot, which disables it."""
    browser, write, meanwhile = scene.one.browser, Rules.write, [True, True]
    text = a_rule(sides(scene.one.joint), scene.rotate, TO_TARGET, BY_SIDE)
    rule = posted(browser, text)

    async def late(self: Rules, written: Rule, known: RuleRecord | None) -> RuleRecord:
        if meanwhile.pop():
            raise Changed
        return await write(self, written, known)

    monkeypatch.setattr(Rules, "write", late)
    meanwhile[:] = [False, True]
    assert browser.http.put(rule, content=text, headers=TURTLE).status_code == 204
    etag = browser.http.get(rule, headers={"accept": "text/turtle"}).headers["etag"]
    meanwhile[:] = [True]
    assert browser.http.put(rule, content=text, headers=TURTLE | {"if-match": etag}).status_code == 412


@pytest.mark.parametrize(("before", "status"), [(True, 412), (False, 204)])
def test_a_stop_during_the_write_of_a_rule_disables_it(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, before: bool, status: int
) -> None:
    """It comes just before the write at Redis, or between the write and its answer."""
    rule, write, write_at_redis = scene.rule(), Rules.write, RuleStore.write
    writing: list[Rules] = []

    async def observed(self: Rules, written: Rule, known: RuleRecord | None) -> RuleRecord:
        writing.append(self)
        if before:
            self._disable_movers(None)
        return await write(self, written, known)

    async def interrupted(self: RuleStore, written: Rule, revision: int, limit: int) -> None:
        await write_at_redis(self, written, revision, limit)
        if not before and written.title == "new":
            writing[0]._disable_movers(None)

    monkeypatch.setattr(Rules, "write", observed)
    monkeypatch.setattr(RuleStore, "write", interrupted)
    assert put(scene.one.browser, rule, '"a rule"', '"new"').status_code == status
    eventually(lambda: disabled(scene.one.browser, rule), "disabled")
    eventually(lambda: disabled(scene.other.browser, scene.other.here(rule)), "disabled at the other gateway")


def test_readers_whose_queries_wait_do_not_keep_rules_from_being_evaluated(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reader of the query endpoint, which counts triples, and a writer of rules have reached their limit."""
    rule, usual = scene.rule(), FairTurns.turn
    clients: set[str] = set()

    def observed(self: FairTurns, client: str) -> contextlib.AbstractAsyncContextManager[None]:
        clients.add(client)
        return usual(self, client)

    monkeypatch.setattr(FairTurns, "turn", observed)
    with monkeypatch.context() as still:  # nothing else is asked meanwhile
        still.setattr(Engine, "_evaluate", _nothing)
        for one in (scene.one, scene.other):
            one.browser.page(f"{one.browser.root}query")
        posted(scene.one.browser, a_rule(sides(scene.one.joint), scene.rotate, TO_TARGET, BY_SIDE))
    full = frozenset(clients)

    def refusing(self: FairTurns, client: str) -> contextlib.AbstractAsyncContextManager[None]:
        if client in full and self._at_once == AT_ONCE:  # the turns of queries, not those of rules
            raise TooManyQueries("8 of your queries are waiting already.")
        return usual(self, client)

    monkeypatch.setattr(FairTurns, "turn", refusing)
    scene.turn(1.5)
    assert fired(scene.one.browser, rule, 1) == [("accepted", "up")]


def test_conditions_are_checked_in_the_turns_of_the_client_that_wrote_them(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So nobody is refused because others write many rules."""
    usual, clients = FairTurns.turn, list[str]()

    def observed(self: FairTurns, client: str) -> contextlib.AbstractAsyncContextManager[None]:
        clients.append(client)
        return usual(self, client)

    monkeypatch.setattr(FairTurns, "turn", observed)
    posted(scene.one.browser, a_rule(sides(scene.one.joint), scene.rotate, TO_TARGET, BY_SIDE))
    assert clients[0] == "127.0.0.1"


def test_an_evaluation_that_was_broken_off_is_repeated_although_nothing_changes(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For example when the machine is short of memory, and ends the process of the query."""
    rule, usual, failures = scene.rule(), QueryProcess.ask, [True] * 3
    time.sleep(3)

    async def broken(self: QueryProcess, make: Callable[[Feed], QueryRequest]) -> bytes:
        if failures:
            failures.pop()
            raise QueryTooCostly("The query exceeded its memory limit.")
        return await usual(self, make)

    monkeypatch.setattr(QueryProcess, "ask", broken)
    scene.turn(1.5)
    assert fired(scene.one.browser, rule, 1) == [("accepted", "up")]
    assert not failures and scene.one.browser.page(rule).one(LF.state) == LF.active


async def _nothing(self: Engine, known: RuleRecord, held: Evaluation | None) -> Evaluation | None:
    return held


def ur5(scene: Scene) -> Page:
    return scene.one.browser.robot("ur5")


def disabled(browser: Browser, rule: str) -> Page | None:
    page = browser.page(rule)
    return page if page.one(LF.state) == LF.disabled else None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no triples"),
        (BEGIN + '<> a lf:Rule ; dcterms:title "x" .', "lf:condition"),
        (a_rule("ASK { ?a ?b ?c }", "{rotate}"), "SELECT"),
        (a_rule("SELECT ?a WHERE { ?a ?b ", "{rotate}"), "lf:condition"),
        (a_rule("SELECT ?a WHERE { SERVICE <http://x/> { ?a ?b ?c } }", "{rotate}"), "SERVICE"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}", 'lf:value [ lf:variable "b" ]'), "does not select ?b"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "http://elsewhere/act"), "not an action of this fleet"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{root}ur5/"), "no action"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}", more="lf:minimumInterval -1"), "minimumInterval"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}", more="lf:intervall 1"), "intervall"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}", more='lf:toldApartBy "c"'), "does not select ?c"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}", more='dcterms:titel "c"'), "<http://purl.org/dc/terms/titel>"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}", more="a <http://a.example/T>"), "<http://a.example/T>"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}") + " <http://b.example/> lf:enabled false .", "b.example"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", '[ lf:variable "a" ; lf:enabled false ]'), "#enabled>"),
        (a_rule("SELECT ?a WHERE { ?a ?b ?c }", "{rotate}") + ' <{rotate}> lf:variable "a" .', "#variable>"),
        *(
            (a_rule(condition, '[ lf:variable "a" ]'), f"binds ?a to '{iri}'")
            for iri in ("http://127.0.0.1:8260/x", "file:///etc/passwd")
            for condition in (
                f"SELECT (<{iri}> AS ?a) WHERE {{ }}",
                f"SELECT ?a WHERE {{ BIND(<{iri}> AS ?a) }}",
                f"PREFIX there: <{iri}> SELECT ?a WHERE {{ BIND(there: AS ?a) }}",
                f"SELECT ?a WHERE {{ VALUES ?a {{ <{{rotate}}> <{iri}> }} }}",
                f"SELECT ?a WHERE {{ VALUES (?b ?a) {{ (1 <{{rotate}}>) ('x'^^<b:c> <{iri}>) }} }}",
            )
        ),
    ],
)  # fmt: skip
def test_an_invalid_rule_is_refused_with_a_link_to_the_shape(scene: Scene, text: str, says: str) -> None:
    text = text.replace("{rotate}", scene.rotate).replace("{root}", scene.one.browser.root)
    answer = post(scene.one.browser, text)
    assert answer.status_code == 422 and says in answer.json()["detail"], answer.text
    assert answer.json()["constraint"] == container(scene.one.browser)


@pytest.mark.parametrize(("length", "status"), [(16_000, 201), (16_385, 422)])
def test_a_condition_may_be_as_long_as_the_shape_says(scene: Scene, length: int, status: int) -> None:
    condition = sides(scene.one.joint).ljust(length)
    assert post(scene.one.browser, a_rule(condition, scene.rotate, TO_TARGET)).status_code == status


def test_rules_go_on_whichever_gateway_dies(tmp_path_factory: pytest.TempPathFactory) -> None:
    """One gateway is killed, then the other; a change without gateways fires once when one is back."""
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre:
        flags = ("--redis-url", memory.url)
        with (
            process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", centre.endpoint),
            gateway(centre, *flags) as one,
            gateway(centre, *flags) as other,
        ):
            live(one.browser, "ur5")
            live(other.browser, "ur5")
            rotate = one.browser.action(one.browser.part("ur5", "wrist_3_joint"), LF.Rotate)
            scene = Scene(memory, centre, one, other, rotate)
            rule = scene.rule()
            scene.turn(1.5)
            assert fired(one.browser, rule, 1) == [("accepted", "up")]
            one.process.send(signal.SIGKILL)
            scene.turn(0.5)
            assert fired(other.browser, other.here(rule), 2)[1:] == [("accepted", "down")]
            other.process.send(signal.SIGKILL)
            scene.turn(1.5)
            with gateway(centre, *flags) as third:
                found = fired(third.browser, third.here(rule), 3)
                assert found == [("accepted", "up"), ("accepted", "down"), ("accepted", "up")]


def test_rules_are_found_from_the_root_and_conform_to_their_blueprints(scene: Scene) -> None:
    rule = scene.rule()
    scene.turn(1.5)
    fired(scene.one.browser, rule, 1)
    listed = scene.one.browser.page(container(scene.one.browser))
    assert (listed.iri, LDP.contains, URIRef(rule)) in listed.graph
    for page in (scene.one.browser.page(rule), scene.one.browser.page(rule + "/firings/1")):
        (blueprint,) = [
            each for each in page.graph.objects(page.iri, HYBRIT.blueprint) if str(each).startswith("http://127")
        ]
        texts = page.response.text, scene.one.browser.page(str(blueprint)).response.text
        data, shapes = (rdflib.Graph().parse(data=text, format="turtle") for text in texts)
        conforms, _, text = pyshacl.validate(data, shacl_graph=shapes, inference="none")
        assert conforms and (page.types & set(shapes.objects(None, SH.targetClass))), text
        assert scene.one.browser.http.get(page.url, headers={"accept": "text/html"}).status_code == 200
