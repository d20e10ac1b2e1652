"""Rules that trigger themselves are disabled; those triggered by others are not."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import pytest

from browser import LDP, LF, Browser
from commanding import angle, begun, of_joint, post, radian
from gateway_group import Gateway, Hub, gateways, hub
from linked_fleet_gateway.extensions.rules.causes import FIRINGS, WITHIN_S, reason_to_disable, self_caused
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from redis_servers import single
from rules_client import BY_SIDE, TO_TARGET, a_rule, container, fired, posted, put, sides
from running import eventually, process
from small_fleet import live

pytestmark = pytest.mark.virtual
SECOND = 10**9
WRIST = "wrist_3_joint"


def known(*times_s: int, revision: int = 1) -> RuleRecord:
    """Return rule ``a`` with firings caused by itself at these times, in seconds."""
    found = RuleRecord(Rule("a", "a rule", "", "/ur5/actions/stop", "http://fleet", "", 0), revision)
    for number, time_s in enumerate(times_s, 1):
        times = self_caused(found, {"a"}, time_s * SECOND)
        found.firings[number] = Firing(time_s * SECOND, {}, FiringState.ACCEPTED, self_caused=times, revision=revision)
    return found


def disabled_at(rule: RuleRecord, time_s: int, *causes: str) -> str:
    return reason_to_disable(rule, causes, self_caused(rule, causes, time_s * SECOND))


def test_a_rule_that_fires_because_of_itself_so_often_in_a_minute_is_disabled() -> None:
    rule = known(*range(0, 2 * (FIRINGS - 1), 2))
    assert "/rules/b" in disabled_at(rule, 2 * FIRINGS, "a", "b")
    assert disabled_at(known(0, 2), 4, "a") == ""


def test_firings_with_other_causes_neither_count_nor_reset_the_count() -> None:
    rule = known(*range(FIRINGS - 1))
    assert disabled_at(rule, 10, "b") == disabled_at(rule, 10) == ""
    times = self_caused(rule, {"b"}, 10 * SECOND)
    rule.firings[99] = Firing(10 * SECOND, {}, self_caused=times, revision=1)
    assert disabled_at(rule, 11, "a")


def test_firings_of_more_than_a_minute_ago_are_not_counted() -> None:
    assert disabled_at(known(*range(FIRINGS - 1)), WITHIN_S, "a") == ""
    assert disabled_at(known(*range(1, FIRINGS)), WITHIN_S, "a")


def test_firings_before_the_clock_was_set_back_are_not_counted() -> None:
    assert disabled_at(known(*range(3600, 3600 + FIRINGS - 1)), 10, "a") == ""
    assert disabled_at(known(*range(10, 10 + FIRINGS - 1)), 9, "a"), "clocks of gateways may differ a little"


def test_enabling_a_rule_resets_the_count() -> None:
    assert disabled_at(replace(known(*range(FIRINGS - 1)), revision=2), 10, "a") == ""


def test_suppressed_firings_are_not_counted() -> None:
    rule = known(*range(FIRINGS - 1))
    suppressed = replace(rule.firings[1], state=FiringState.SUPPRESSED)
    assert disabled_at(replace(rule, firings={1: suppressed}), 10, "a") == ""


@dataclass
class Scene:
    """The robot of ``hub`` is moved by the test; rules move the other robot."""

    hub: Hub
    one: Gateway
    other: Gateway

    @property
    def browser(self) -> Browser:
        return self.one.browser

    def pair(self, low: float = 0.1, high: float = 0.3) -> list[str]:
        """Create two rules, each of which moves a joint so that the other's condition holds."""
        joint, action = self.browser.part("ur5", WRIST).url, of_joint(self.browser, WRIST)
        return [
            self.rule(joint, f"?x < {low}", action, high + 0.1),
            self.rule(joint, f"?x > {high}", action, low - 0.1),
        ]

    def rule(self, joint: str, holds: str, action: str, target: float, more: str = "lf:minimumInterval 0") -> str:
        condition = (
            sides(joint).replace("BIND(?x / 10 AS ?target)", f"FILTER({holds})").replace("?side ?target", "?side")
        )
        return posted(self.browser, a_rule(condition, action, f"vom:numericalValue {target} ; vom:unit unit:RAD", more))

    def active(self, *rules: str) -> None:
        for rule in rules:
            eventually(lambda rule=rule: self.browser.page(rule).one(LF.state) == LF.active, "evaluated")

    def move(self, value: float) -> None:
        begun(post(self.browser, of_joint(self.browser, WRIST), radian(value)))

    def turn(self, value: float) -> None:
        self.hub.steps = round(value * 1000)
        self.hub.repeat()


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        stack.enter_context(process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for each in (one, other):
            live(each.browser, "ur5")
        yield Scene(centre, one, other)


@pytest.fixture
def scene(fleet: Scene) -> Iterator[Scene]:
    """Yield the scene with the joint between both thresholds, and remove all rules afterwards."""
    fleet.move(0.2)
    eventually(lambda: abs(angle(fleet.browser, WRIST) - 0.2) < 0.02, "in the middle")
    yield fleet
    for rule in fleet.browser.page(container(fleet.browser)).graph.objects(None, LDP.contains):
        assert fleet.browser.http.delete(str(rule)).status_code == 204


def test_two_rules_that_undo_each_other_are_ended(scene: Scene) -> None:
    rules = scene.pair()
    scene.active(*rules)
    scene.move(0.5)
    ended = eventually(
        lambda: [each for each in rules if scene.browser.page(each).one(LF.state) == LF.disabled],
        lambda: "\n".join(scene.browser.page(each).response.text for each in rules),
    )
    assert len(ended) == 1  # without it the other has nothing to undo
    page = scene.browser.page(ended[0])
    reason = str(page.graph.value(page.iri, LF.reason))
    (through,) = set(rules) - set(ended)
    assert "own firings" in reason and through.rpartition("/rules/")[2] in reason
    assert "rule_loops_total 1.0" in metrics(scene.one) + metrics(scene.other)
    firings = [scene.browser.page(f"{ended[0]}/firings/{number}") for number in (1, 2)]
    assert [set(map(str, each.graph.objects(each.iri, LF.causedBy))) for each in firings][1] == set(rules)
    assert ended[0] not in map(str, firings[0].graph.objects(firings[0].iri, LF.causedBy))
    assert put(scene.browser, ended[0], "lf:enabled false", "lf:enabled true").status_code == 204
    scene.active(ended[0])


def metrics(gateway: Gateway) -> str:
    return gateway.get(gateway.browser.root + "metrics").text


def test_a_rule_that_a_person_makes_fire_all_the_time_is_left_alone(scene: Scene) -> None:
    """Its own motions are long, and it does not state which robot it moves."""
    action = of_joint(scene.browser, WRIST)
    scene.turn(0.5)
    eventually(lambda: '"0.5"' in scene.one.get(scene.one.rotation).text, "down")
    rule = posted(scene.browser, a_rule(sides(scene.one.joint), action, TO_TARGET, BY_SIDE))
    scene.active(rule)
    for count in range(1, 2 * FIRINGS + 1):
        scene.turn(1.5 if count % 2 else 0.5)
        fired(scene.browser, rule, count)
    page = scene.browser.page(rule)
    assert page.one(LF.state) == LF.active
    assert list(scene.browser.page(f"{rule}/firings/{count}").graph.objects(None, LF.causedBy)) == []
