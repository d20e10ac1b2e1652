"""R0.5: what of a robot may be replaced by PUT, at any gateway and permanently, and what may not."""

import signal
from pathlib import Path

import httpx
import pytest
import rdflib
from rdflib import URIRef

from browser import DCTERMS, HYBRIT, LF, RDFS, VOM, Browser, Page
from commanding import (
    PAN,
    PREFIXES,
    STILL_RAD,
    TURTLE,
    WRIST,
    all_see,
    angle,
    arm,
    at_all,
    begun,
    of_joint,
    of_robot,
    post,
    problem,
    put,
)
from gateway_group import Gateway, gateway, gateways, hub
from redis_servers import single
from running import eventually

pytestmark = pytest.mark.virtual
_READ = "GET, HEAD, OPTIONS"
_TYPES = "text/turtle, application/ld+json, application/n-triples, application/rdf+xml"


@pytest.fixture
def pair(two: list[Gateway]) -> tuple[Gateway, Gateway]:
    one, other = two
    return one, other


def _setting(browser: Browser, predicate: URIRef) -> Page:
    return browser.page(str(browser.robot("ur5").one(predicate)))


def _title(browser: Browser) -> Page:
    return browser.page(str(browser.robot("ur5").property(LF.TextProperty)))


def _target(browser: Browser, joint: str = WRIST) -> Page:
    return browser.page(str(browser.part("ur5", joint).one(LF.targetRotation)))


def _number(page: Page) -> float | URIRef:
    value = page.graph.value(page.graph.value(page.iri, LF.value), VOM.numericalValue)
    return value if isinstance(value, URIRef) else float(str(value))


def _text(value: str) -> str:
    return PREFIXES + f'<> lf:value "{value}" .'


def _scalar(value: object, unit: str = "unit:UNITLESS") -> str:
    return PREFIXES + f"<> lf:value [ vom:numericalValue {value} ; vom:unit {unit} ] ."


def _titles(browser: Browser) -> set[str]:
    """Return the robot's titles in the fleet, in its own description, and as a property."""
    fleet, robot = browser.page(browser.root), browser.robot("ur5")
    setting = _title(browser)
    return {
        str(fleet.graph.value(robot.iri, DCTERMS.title)),
        str(robot.graph.value(robot.iri, DCTERMS.title)),
        str(setting.graph.value(setting.iri, LF.value)),
    }


def test_a_title_is_shown_everywhere_and_stays(tmp_path: Path) -> None:
    """In the fleet and at the robot, at both gateways, and after both were killed."""
    with hub() as stage, single(tmp_path) as memory, arm(stage.endpoint):
        with gateways(stage, memory.url) as found:
            all_see(found)
            answer = put(found[0].browser, _title(found[0].browser).url, _text("Grüße aus Halle 2"))
            assert (answer.status_code, answer.content) == (204, b"")
            at_all(found, lambda each: _titles(each.browser) == {"Grüße aus Halle 2"}, "the title")
            for each in found:
                each.process.send(signal.SIGKILL)
        with gateway(stage, "--redis-url", memory.url) as back:
            all_see([back])
            assert _titles(back.browser) == {"Grüße aus Halle 2"}


# -- annotations ----------------------------------------------------------------------------------------------------


_POSE = f"""<./> rdfs:comment "borrowed" ; lf:namedPose [ dcterms:title "tucked" ;
  lf:target [ lf:ofJoint <{WRIST}> ; vom:numericalValue 0.7 ; vom:unit unit:RAD ] ] ."""
_RDFS = "@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .\n"


def test_a_pose_in_annotations_can_be_assumed(pair: tuple[Gateway, Gateway]) -> None:
    """Put at one gateway, offered and assumed at the other, where the robot has the comment."""
    one, other = pair
    answer = put(one.browser, _setting(one.browser, LF.annotations).url, _RDFS + PREFIXES + _POSE)
    assert answer.status_code == 204, answer.text
    robot = eventually(lambda: _commented(other, "borrowed"), "the annotation")
    assert (robot.iri, LF.namedPose, None) in robot.graph
    action = of_robot(other.browser, LF.AssumePose)
    assert rdflib.Literal("tucked") in set(other.browser.page(action).graph.objects())
    begun(put(other.browser, action, PREFIXES + '<> lf:poseName "tucked" .', prefer="wait=30"))
    assert angle(other.browser, WRIST) == pytest.approx(0.7, abs=STILL_RAD)
    unknown = put(other.browser, action, PREFIXES + '<> lf:poseName "nowhere" .')
    assert problem(unknown) == (422, "unprocessable-content")


def _commented(gateway: Gateway, text: str) -> Page | None:
    robot = gateway.browser.robot("ur5")
    return robot if (robot.iri, RDFS.comment, rdflib.Literal(text)) in robot.graph else None


def test_clients_cannot_lose_what_the_robot_says(pair: tuple[Gateway, Gateway]) -> None:
    """PUT replaces the clients' statements, DELETE removes them; comments and named poses of the agent always stay."""
    one, _ = pair
    url = _setting(one.browser, LF.annotations).url
    assert one.browser.http.delete(url).status_code == 204
    agents = one.get(url).text
    poses = _offered_poses(one.browser)
    assert poses
    assert put(one.browser, url, _RDFS + PREFIXES + _POSE).status_code == 204
    assert _offered_poses(one.browser) == {*poses, "tucked"}
    assert put(one.browser, url, '<./> <http://example.org/colour> "red" .').status_code == 204
    assert _offered_poses(one.browser) == poses
    assert '"red"' in one.get(url).text
    assert one.browser.http.delete(url).status_code == 204
    assert one.get(url).text == agents


def _offered_poses(browser: Browser) -> set[str]:
    robot = browser.robot("ur5")
    return {str(robot.graph.value(pose, DCTERMS.title)) for pose in robot.graph.objects(robot.iri, LF.namedPose)}


def test_annotations_are_bounded(pair: tuple[Gateway, Gateway]) -> None:
    """413 for a body beyond the limit and for too many triples."""
    one, _ = pair
    url = _setting(one.browser, LF.annotations).url
    comment = '<./> rdfs:comment "{}" .'
    assert problem(put(one.browser, url, _RDFS + comment.format("x" * 70_000))) == (413, "payload-too-large")
    many = " , ".join(f'"{number}"' for number in range(250))
    assert problem(put(one.browser, url, f'<./> <urn:p> {many} , "a", "b", "c", "d", "e", "f", "g" .')) == (
        413,
        "payload-too-large",
    )


# -- speed ----------------------------------------------------------------------------------------------------------


def test_a_robot_can_be_slowed_down(pair: tuple[Gateway, Gateway]) -> None:
    """A maximum speed scale of 0.3 set at one gateway makes a motion at the other take about three times as long."""
    one, other = pair
    url = _setting(one.browser, LF.maximumSpeedScale).url
    durations = []
    for scale in (1.0, 0.3):
        assert put(one.browser, url, _scalar(scale)).status_code == 204
        at_all([one, other], lambda each, scale=scale: _scale(each) == pytest.approx(scale), "the scale")
        durations.append(_rehearsed(other.browser))
    assert put(other.browser, url.replace(one.browser.root, other.browser.root), _scalar(1)).status_code == 204
    assert durations[1] / durations[0] == pytest.approx(1 / 0.3, rel=0.2)


def _scale(gateway: Gateway) -> float | URIRef:
    return _number(_setting(gateway.browser, LF.maximumSpeedScale))


def _rehearsed(browser: Browser) -> float:
    """Return how long a rotation by 2 rad would take, in seconds."""
    start = angle(browser, PAN)
    target = start + (2 if start < 0 else -2)
    body = PREFIXES + f"<> vom:numericalValue {target} ; vom:unit unit:RAD ."
    answer = put(browser, of_joint(browser, PAN), body, prefer="dry-run")
    assert answer.status_code == 200, answer.text
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    ((_, _, duration),) = graph.triples((None, LF.duration, None))
    return float(graph.value(duration, VOM.numericalValue))


# -- where a joint is to be -----------------------------------------------------------------------------------------


def test_a_joint_is_moved_by_its_target(pair: tuple[Gateway, Gateway]) -> None:
    """PUT moves it, and GET shows the target, also after another PUT; after a stop the target is unknown."""
    one, _ = pair
    browser = one.browser
    for target in (0.9, 0.4):
        answer = put(browser, _target(browser).url, _scalar(target, "unit:RAD"), prefer="wait=30")
        begun(answer)
        assert angle(browser, WRIST) == pytest.approx(target, abs=STILL_RAD)
        assert _number(_target(browser)) == pytest.approx(target)
    start = angle(browser, PAN)
    far = round(start + (3 if start < 0 else -3), 3)
    for _ in range(2):
        begun(put(browser, _target(browser, PAN).url, _scalar(far, "unit:RAD")))
    first = begun(put(browser, _target(browser, PAN).url, _scalar(far, "unit:RAD")))
    eventually(lambda: browser.page(first).one(LF.state) == LF.running, "the motion")
    assert _number(_target(browser, PAN)) == pytest.approx(far)
    begun(post(browser, of_robot(browser, LF.StopRobot), prefer="wait=30"))
    for joint in (PAN, WRIST):
        eventually(lambda joint=joint: _number(_target(browser, joint)) == LF.unknown, "an unknown target")


# -- HTTP -----------------------------------------------------------------------------------------------------------


def _options(browser: Browser, url: str) -> httpx.Headers:
    answer = browser.http.options(url)
    assert answer.status_code == 204
    return answer.headers


def test_writable_properties_state_accept_put(pair: tuple[Gateway, Gateway]) -> None:
    """OPTIONS and GET of every property of robot and joint state Allow and Accept-Put; the rest is 405."""
    one, _ = pair
    robot, joint = one.browser.robot("ur5"), one.browser.part("ur5", WRIST)
    urls = {str(url) for page in (robot, joint) for url in page.graph.objects(page.iri, HYBRIT.property)}
    settings = (LF.annotations, LF.maximumSpeedScale, LF.placement, LF.availability, LF.tags)
    settable = {str(robot.one(each)) for each in settings}
    settable.add(str(robot.property(LF.TextProperty)))
    settable.add(str(joint.one(LF.targetRotation)))
    assert settable < urls
    assert len(urls - settable) > 5
    for url in urls:
        fields = [_options(one.browser, url), one.get(url).headers]
        allow, types = (f"{_READ}, PUT", _TYPES) if url in settable else (_READ, None)
        if types and url != str(robot.one(LF.annotations)):  # whose members have no known meaning
            types += ", application/json"
        allow += ", PATCH" if types and url != str(joint.one(LF.targetRotation)) else ""
        allow += ", DELETE" if url in {str(robot.one(each)) for each in (LF.annotations, LF.placement, LF.tags)} else ""
        assert [(each["allow"], each.get("accept-put")) for each in fields] == 2 * [(allow, types)], url
        if url not in settable:
            answer = one.browser.http.put(url, content=_scalar(1), headers=TURTLE)
            assert (*problem(answer), answer.headers["allow"]) == (405, "method-not-allowed", _READ)
        assert one.browser.http.post(url).headers["allow"] == allow


def test_without_redis_nothing_is_set(tmp_path: Path) -> None:
    """503, and former settings stay visible."""
    with (
        hub() as stage,
        single(tmp_path) as memory,
        arm(stage.endpoint),
        gateway(stage, "--redis-url", memory.url) as one,
    ):
        all_see([one])
        url = _title(one.browser).url
        assert put(one.browser, url, _text("before")).status_code == 204
        memory.kill()
        assert problem(put(one.browser, url, _text("after"))) == (503, "redis-unavailable")
        assert _titles(one.browser) == {"before"}
