"""A body about another resource than the one that it was sent to is refused, wherever a body is taken."""

import json
from collections.abc import Iterator

import pytest

from browser import HYBRIT, Browser
from commanding import PREFIXES, TURTLE, angle
from rules_client import a_rule
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

_AT = "lf:position [ maths:x 9 ; maths:y 9 ; maths:z 0.5 ; vom:unit unit:M ]"
_RADIAN = "vom:numericalValue 0.2 ; vom:unit unit:RAD"
_ELSEWHERE = "ur5/elbow_joint"
_WRITES = {
    "rotate": ("POST", "ur5/wrist_3_joint/actions/rotate", _RADIAN),
    "rotate again": ("PUT", "ur5/wrist_3_joint/actions/rotate", _RADIAN),
    "moveJoints": ("POST", "ur5/actions/moveJoints", f"lf:joint [ lf:ofJoint </ur5/wrist_3_joint> ; {_RADIAN} ]"),
    "target": ("PUT", "ur5/wrist_3_joint/targetRotation", f"lf:value [ {_RADIAN} ]"),
    "title": ("PUT", "ur5/title", 'lf:value "Arm"'),
    "speed": ("PUT", "ur5/maximumSpeedScale", "lf:value [ vom:numericalValue 0.5 ]"),
    "placement": ("PUT", "ur5/placement", _AT),
    "annotations": ("PUT", "ur5/annotations", "<urn:x/colour> 'red'"),
    "lease": ("PUT", "ur5/lease", 'lf:holder "me" ; lf:leaseDuration 60'),
    "object": (
        "POST",
        "world/objects",
        f'dcterms:title "crate" ; {_AT} ; lf:geometry [ a lf:Sphere ; '
        "lf:radius [ vom:numericalValue 0.2 ; vom:unit unit:M ] ]",
    ),
    "subscription": (
        "POST",
        "ur5/wrist_3_joint/subscriptions",
        f"a <{HYBRIT.Subscription}> ; <{HYBRIT.onResource}> </ur5/wrist_3_joint>",
    ),
}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("place"))
    with place.gateway() as (gateway, browser), place.ur5():
        live(browser, "ur5")
        yield browser
        assert "Traceback" not in gateway.output, gateway.output


@pytest.mark.parametrize("name", _WRITES)
def test_a_body_about_another_resource_is_refused(browser: Browser, name: str) -> None:
    method, path, said = _WRITES[name]
    before = angle(browser, "wrist_3_joint"), browser.http.get(browser.root + "world/objects").text
    body = f"{PREFIXES}<{browser.root}{_ELSEWHERE}> {said} ."
    answer = browser.http.request(method, browser.root + path, content=body, headers=TURTLE)
    assert answer.status_code == 422, answer.text
    assert browser.root + _ELSEWHERE in answer.json()["detail"]
    assert (angle(browser, "wrist_3_joint"), browser.http.get(browser.root + "world/objects").text) == before


def test_a_rule_about_another_resource_is_refused(browser: Browser) -> None:
    said = a_rule("SELECT ?s { ?s ?p ?o }", browser.root + "actions/stopAll")
    for content in (said.replace("<> a", "</ur5/> a"), said.replace("<> a lf:Rule ;", "</ur5/>")):
        answer = browser.http.post(browser.root + "rules", content=content, headers=TURTLE)
        assert answer.status_code == 422 and f"<{browser.root}ur5/>" in answer.json()["detail"], answer.text


@pytest.mark.parametrize(
    ("id", "status"), [("/ur5/elbow_joint", 422), ("", 204), ("rotate", 204), ("_:b", 204), (None, 204)]
)
def test_the_id_of_json_ld_is_the_subject(browser: Browser, id: str | None, status: int) -> None:
    vom = "http://vocab.arvida.de/2015/06/vom/vocab#"
    said = {
        f"{vom}numericalValue": angle(browser, "wrist_3_joint"),
        f"{vom}unit": {"@id": "http://qudt.org/vocab/unit/RAD"},
    }
    content = json.dumps(said if id is None else {"@id": id, **said})
    url = browser.root + "ur5/wrist_3_joint/actions/rotate"
    answer = browser.http.post(url, content=content, headers={"content-type": "application/ld+json"})
    assert answer.status_code == status, answer.text


def test_the_description_of_a_subscription_creates_another_one(browser: Browser) -> None:
    method, path, said = _WRITES["subscription"]
    url = browser.root + path
    made = browser.http.request(method, url, content=f"{PREFIXES}[] {said} .", headers=TURTLE)
    described = browser.http.get(made.headers["location"], headers={"accept": "text/turtle"}).text
    again = browser.http.post(url, content=described, headers=TURTLE)
    assert again.status_code == 201 and again.headers["location"] != made.headers["location"]
    elsewhere = described.replace("/wrist_3_joint/subscriptions/", "/elbow_joint/subscriptions/")
    assert elsewhere != described
    refused = browser.http.post(url, content=elsewhere, headers=TURTLE)
    assert refused.status_code == 422 and "/ur5/elbow_joint/subscriptions/" in refused.json()["detail"]
