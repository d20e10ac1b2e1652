"""Every write of a gateway with all extensions: a demand that is not honoured is refused, and nothing changes."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Any, NamedTuple

import httpx
import pytest

from browser import HYBRIT, Browser
from commanding import PREFIXES, TURTLE, begun, ended
from commands import pose_body
from floor_maps import yaml
from mcp_client import BOTH, VERSION
from rules_client import a_rule
from small_fleet import Place as AtPorts
from small_fleet import live
from walk import Walk, walk

pytestmark = pytest.mark.virtual

_AT = "lf:position [ maths:x 9 ; maths:y 9 ; maths:z 0.5 ; vom:unit unit:M ]"
_CRATE = f"""<> <http://purl.org/dc/terms/title> "crate" ; {_AT} ;
    lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 0.2 ; vom:unit unit:M ] ] ."""
_RECEIVER = f'<{HYBRIT.callbackURL}> "http://127.0.0.1:9/"'
_NEVER = "SELECT ?s { ?s ?p ?o FILTER(false) }"
_ID = re.compile("[0-9a-f]{8}-[0-9a-f-]{27}")
_VARIES = re.compile(r"\?|/audit")
_UPDATE = "PREFIX lf: <https://w3id.org/linked-fleet#> DELETE DATA { <urn:x/s> <urn:x/p> <urn:x/o> }"
_OPENED = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {"protocolVersion": VERSION, "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}},
}


_STOPS = ("hold", "stop", "stopAll", "cancel")


class Write(NamedTuple):
    method: str
    url: str

    @property
    def name(self) -> str:
        """The last segment of the path that is no id."""
        return next(each for each in reversed(self.url.split("/")) if each and not _ID.fullmatch(each))

    @property
    def stops(self) -> bool:
        return self.name in _STOPS or (self.method == "DELETE" and self.name == "invocations")


def _subscription(resource: str) -> str:
    return f"<> a <{HYBRIT.Subscription}> ; <{HYBRIT.onResource}> <{resource}> ; {_RECEIVER} ."


@dataclass
class Place:
    browser: Browser
    tree: Walk
    examples: dict[str, str]
    """Bodies of actions in plain JSON, by name."""

    def __post_init__(self) -> None:
        self._numbers = count()
        http, mission = self.browser.http, {"title": "m", "step": {"type": "notify", "text": "hello"}}
        self._mission = http.post(self.browser.root + "missions", json=mission).headers["location"]
        before, self._last = _texts(self.tree), _texts(walk(self.browser.root, self.browser.http))
        self._steady = {url for url, text in self._last.items() if text == before.get(url)}

    @cached_property
    def joint(self) -> str:
        return next(
            page.url for page in self.tree.of("joint") if any("/actions/rotate" in each for each in page.targets)
        )

    @cached_property
    def writes(self) -> list[Write]:
        allowed = {page.url: page.response.headers.get("allow", "") for page in self.tree}
        allowed |= {self.browser.root + "mcp": "POST, DELETE"}  # its resource has no link
        del allowed[self.browser.root + "query"]  # a query changes nothing
        return [
            Write(method, url)
            for url, allow in sorted(allowed.items())
            for method in allow.split(", ")
            if method and method not in ("GET", "HEAD", "OPTIONS")
        ]

    def content(self, write: Write) -> tuple[str, str]:
        """Return a body that has an effect, and its media type; both are empty for a write without body."""
        if write.method == "DELETE" or write.stops or write.name in ("resume", "reset"):
            return "", ""
        if write.method == "PATCH":
            return _UPDATE, "application/sparql-update"
        if write.name == "reach":
            return PREFIXES + pose_body(f"{self.browser.root}ur5/tool0", (0.3, 0.3, 0.4)), "text/turtle"
        if write.name == "raiseFault":
            return f"{PREFIXES}<> lf:about <{self.browser.root}ur5/> ; dcterms:title 'It rattles.' .", "text/turtle"
        if write.name == "map":
            files = {"yaml": ("floor.yaml", yaml()), "image": ("floor.pgm", b"P2 2 1 255 254 0")}
            form = httpx.Request("PUT", write.url, files=files)
            return form.read().decode(), form.headers["content-type"]
        if write.name in self.examples:
            return self.examples[write.name], "application/json"
        turtle = {
            "targetRotation": "<> lf:value [ vom:numericalValue 0.1 ; vom:unit unit:RAD ] .",
            "objects": _CRATE,
            "title": '<> lf:value "Arm" .',
            "annotations": "<./> <urn:x/colour> 'red' .",
            "maximumSpeedScale": "<> lf:value [ vom:numericalValue 0.5 ] .",
            "placement": f"<> {_AT} .",
            "availability": '<> lf:inService false ; lf:reason "worn" .',
            "tags": '<> lf:tag "arms" , "hall 3" .',
            "stopLatches": f"<> lf:latchAbout <{self.browser.root}ur5/> .",
            "boards": f"<> dcterms:title 'Elbows' ; lf:boardLine <{self.browser.root}ur5/elbow_joint/rotation> .",
            "notes": f"<> lf:noteText 'Mind the cable.' ; lf:noteAbout <{self.browser.root}ur5/> .",
            "poses": f'<> dcterms:title "here {next(self._numbers)}" .',
            "mode": '<> lf:value "automatic" .',
            "speedScale": "<> lf:value [ vom:numericalValue 0.5 ] .",
            "output": "<> lf:value true .",
            "toolInput": "<> lf:value true .",
            "stopProtectively": "",
            "remark": "<> lf:remark 'It is being serviced.' .",
            "missions": '<> <http://purl.org/dc/terms/title> "m" ; lf:step [ a lf:NotifyStep ; lf:text "hello" ] .',
            "queue": f"<> lf:mission <{self._mission}> .",
            "schedules": f"<> lf:orderTemplate [ lf:mission <{self._mission}> ] ; lf:recurrenceRule 'FREQ=DAILY' ;"
            " lf:startsAt '2040-01-01T09:00' ; lf:timeZone 'UTC' .",
            "rules": a_rule(_NEVER, self.browser.root + "actions/stopAll"),
            "subscriptions": _subscription(write.url.removesuffix("/subscriptions")),
        }
        return PREFIXES + turtle[write.name], "text/turtle"

    def send(self, write: Write, **fields: str) -> httpx.Response:
        content, media_type = self.content(write)
        headers = {"accept": BOTH if write.name == "mcp" else "*/*", **fields}
        if media_type:
            headers["content-type"] = media_type
        return self.browser.http.request(write.method, write.url, content=content or None, headers=headers)

    def changes(self) -> set[str]:
        """Return what has come, gone or changed since the last call; values that change by themselves do not count."""
        before, self._last = self._last, _texts(walk(self.browser.root, self.browser.http))
        return (before.keys() ^ self._last.keys()) | {
            url for url in self._steady & before.keys() if before[url] != self._last.get(url)
        }


def _texts(tree: Walk) -> dict[str, str]:
    """Return all resources as text, except the audit, parts of histories and the progress of deliveries."""
    return {
        page.url: "" if "/subscriptions" in page.url else page.response.text
        for page in tree
        if not _VARIES.search(page.url)
    }


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    here = AtPorts(tmp_path_factory.mktemp("place"))
    with here.gateway() as (gateway, browser), here.ur5():
        live(browser, "ur5")
        _create_members(browser)
        described = browser.http.get(browser.root + "openapi.json", headers={"accept": "application/json"}).json()
        yield Place(browser, walk(browser.root, browser.http), _examples(described["paths"]))
        assert "Traceback" not in gateway.output, gateway.output


def _create_members(browser: Browser) -> None:
    """Create one of each thing that can be created."""
    robot = str(browser.robot("ur5").iri)
    ended(browser, begun(browser.http.post(f"{robot}actions/stop")))  # only one in progress can be cancelled
    for url, content in (
        (f"{browser.root}rules", a_rule(_NEVER, browser.root + "actions/stopAll")),
        (f"{browser.root}world/objects", PREFIXES + _CRATE),
        (
            f"{robot}subscriptions",
            PREFIXES + f"<> a <{HYBRIT.Subscription}> ; <{HYBRIT.onResource}> <{robot}> ; {_RECEIVER} .",
        ),
    ):
        answer = browser.http.post(url, content=content, headers=TURTLE)
        assert answer.status_code == 201, answer.text


def _examples(paths: dict[str, Any]) -> dict[str, str]:
    found = {"mcp": json.dumps(_OPENED), "lease": '{"holder": "me", "duration": 60}'}
    for path, item in paths.items():
        if "/actions/" in path and (body := item.get("post", {}).get("requestBody")):
            (example,) = body["content"]["application/json"]["examples"].values()
            found[path.rpartition("/")[2]] = json.dumps(example["value"])
    return found


@pytest.mark.parametrize(
    ("fields", "refused"),
    [
        ({"prefer": "dry-run"}, {400}),
        ({"prefer": "handling=strict, unheard-of"}, {400}),
        ({"if-match": '"0000"'}, {412}),
        ({"if-none-match": "*"}, {412}),
        ({"if-unmodified-since": "Sat, 29 Oct 1994 19:43:31 GMT"}, {412}),
        ({"if": "(<urn:uuid:12345678-1234-1234-1234-123456789abc>)"}, {412}),
    ],
    ids=str,
)
def test_no_write_ignores_what_its_client_excludes(place: Place, fields: dict[str, str], refused: set[int]) -> None:
    dry, rehearsed = "dry-run" in fields.values(), set()
    for write in place.writes:
        if write.stops and not dry:
            continue  # nothing prevents a stop
        answer = place.send(write, **fields)
        if dry and answer.status_code in (200, 204):
            assert answer.headers.get("preference-applied") == "dry-run", write
            rehearsed.add(write.name)
        else:
            assert answer.status_code in refused, (write, answer.text)
    assert not place.changes()
    if dry:
        assert rehearsed > {"stop", "stopAll", "hold", "rotate", "moveJoints", "reach"}


def test_the_same_writes_have_an_effect_without_the_field(place: Place) -> None:
    one_each = {(write.method, write.name): write for write in place.writes}
    assert len(one_each) > 30
    refused = {
        (write.method, write.name)
        for write in sorted(one_each.values(), key=_order)
        if place.send(write).status_code not in (200, 201, 204)
    }
    # They need a token, a session, and a robot that is offline.
    assert refused == {("DELETE", "lease"), ("DELETE", "mcp"), ("DELETE", "ur5")}


def _order(write: Write) -> tuple[bool, ...]:
    """Return a key by which those come last after which others have no effect."""
    return write.name == "lease", write.method == "DELETE", write.name in ("stopProtectively", "stopLatches")


def test_a_callback_by_get_is_not_created_in_a_rehearsal(place: Place) -> None:
    upgrade = {"connection": "upgrade", "upgrade": "callback", "callback": "http://127.0.0.1:9/"}
    for fields in ({"prefer": "dry-run"}, {"idempotency-key": "1"}, {"lock-token": "<urn:uuid:1>"}):
        answer = place.browser.http.get(place.joint, headers={**upgrade, **fields})
        assert answer.status_code == 400, answer.text
    assert place.browser.http.get(place.joint, headers=upgrade).status_code == 201
