"""Streams and callbacks end with a right, and what an unreadable file changes."""

import asyncio
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from authenticated_gateway import ALL, SEEN, AuthenticatedGateway, run_authenticated
from browser import HYBRIT, LF, Browser
from issuer import Issuer, issuing
from linked_fleet_identity.rights import Claims
from linked_fleet_identity.roster import parse_roster
from linked_fleet_identity.service import Identities
from receivers import CallbackReceiver
from running import eventually, process
from small_fleet import Place
from subscribers import Events, Socket

pytestmark = pytest.mark.virtual
_TURTLE = {"content-type": "text/turtle"}
_PREFIXES = f"@prefix hybrit: <{HYBRIT}> . @prefix lf: <{LF}> .\n"


@pytest.fixture(scope="module")
def issuer() -> Iterator[Issuer]:
    with issuing() as one:
        yield one


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory, issuer: Issuer) -> Iterator[AuthenticatedGateway]:
    """Only for this file, since the file of identities changes all the time."""
    with run_authenticated(tmp_path_factory.mktemp("guarded"), "--subscriptions-per-client=8", issuer=issuer) as one:
        yield one


@pytest.fixture
def root(own: AuthenticatedGateway) -> Iterator[Browser]:
    with own.browsing("root") as browser:
        yield browser


def _joint(browser: Browser) -> str:
    return browser.part(SEEN, "wrist_3_joint").url


def _bearer(own: AuthenticatedGateway, name: str) -> str:
    return f"Bearer {own.tokens[name]}"


def test_a_websocket_ends_with_the_token(own: AuthenticatedGateway, root: Browser) -> None:
    own.add("short", "read", "subscribe")
    own.known("short")
    with Socket(_joint(root), Authorization=_bearer(own, "short")) as open_:
        open_.raw()
        own.revoke("short")
        assert open_.until_closed()[0] == 1008
    with own.browsing("short") as browser:
        assert browser.http.get(own.root).status_code == 401


@pytest.mark.parametrize("change", ["fewer rights", "other robots"])
def test_a_websocket_ends_when_rights_change(own: AuthenticatedGateway, root: Browser, change: str) -> None:
    own.add("changing", "read", "subscribe")
    own.known("changing")
    with Socket(_joint(root), Authorization=_bearer(own, "changing")) as open_:
        open_.raw()
        before = own.tables["changing"]
        own.tables["changing"] = (
            before.replace(', "subscribe"', "") if change == "fewer rights" else before.replace('["*"]', '["lab-*"]')
        )
        own.write()
        assert open_.until_closed()[0] == 1008


def test_a_stream_ends_with_the_right_that_its_resource_takes(own: AuthenticatedGateway, root: Browser) -> None:
    """Who is here is for those who act or administer."""
    own.add("acting", "read", "subscribe", "act")
    own.known("acting")
    with Socket(root.root + "people", Authorization=_bearer(own, "acting")) as open_:
        open_.raw()
        own.tables["acting"] = own.tables["acting"].replace(', "act"', "")
        own.write()
        assert open_.until_closed()[0] == 1008


def test_an_event_stream_ends_with_the_token_and_does_not_come_back(own: AuthenticatedGateway, root: Browser) -> None:
    own.add("listener", "read", "subscribe")
    own.known("listener")
    headers = {"accept": "text/event-stream", "authorization": _bearer(own, "listener")}
    with httpx.Client(timeout=20) as http, http.stream("GET", _joint(root), headers=headers) as response:
        stream = Events(response)
        stream.next()
        own.revoke("listener")
        assert stream.ended()
        assert stream.last_event_id == "cancelled"  # answered with 204 if the caller may ask, which ends EventSource


def test_a_stream_ends_when_a_token_of_an_issuer_expires(
    own: AuthenticatedGateway, root: Browser, issuer: Issuer
) -> None:
    token = issuer.token(exp=int(time.time()) - 25)  # within the leeway of 30 s
    with Socket(_joint(root), Authorization=f"Bearer {token}") as open_:
        open_.raw()
        assert open_.until_closed()[0] == 1008


def test_a_stream_that_is_still_allowed_goes_on(own: AuthenticatedGateway, root: Browser) -> None:
    own.add("lasting", "read", "subscribe")
    own.known("lasting")
    with Socket(own.root, Authorization=_bearer(own, "lasting")) as lasting:
        lasting.raw()
        with Socket(own.root, Authorization=_bearer(own, "root")) as other:
            other.raw()
            own.tables["another"] = (
                own.tables["lasting"]
                .replace("lasting", "another")
                .replace(own.tables["lasting"].split('sha256 = "')[1][:64], "0" * 64)
            )
            own.write()
            with process("-m", "linked_fleet_agent", "--robot=lab-9=ur5", "--connect", own.place.zenoh):
                while "lab-9" not in lasting.raw():
                    pass


def test_a_callback_is_suspended_when_the_token_of_its_creator_is_revoked(
    own: AuthenticatedGateway, root: Browser, receiver: CallbackReceiver
) -> None:
    own.add("caller", "read", "subscribe")
    own.known("caller")
    container = str(root.part(SEEN, "wrist_3_joint").one(HYBRIT.subscriptions))
    body = (
        _PREFIXES + f"[] a hybrit:Subscription, hybrit:WebCallback ; hybrit:onResource <{_joint(root)}> ; "
        f'hybrit:callbackURL "{receiver.url()}" .'
    )
    with own.browsing("caller") as caller:
        made = caller.http.post(container, content=body, headers=_TURTLE)
        assert made.status_code == 201, made.text
        receiver.wait(1, method="POST")
    own.revoke("caller")
    mine = made.headers["location"]

    def reason() -> str | None:
        page = root.page(mine)
        return str(page.one(LF.reason)) if page.one(LF.deliveryState) == LF.suspended else None

    assert eventually(reason, "suspended") == "the rights of its creator ended"
    resume = str(root.page(mine).one(HYBRIT.action))
    assert root.http.post(resume).status_code == 409
    own.add("caller", "read", "subscribe")  # another token of that name: the same identity
    own.known("caller")
    count = len(receiver.log(method="POST"))
    assert root.http.post(resume).status_code == 204
    # Former values are not repeated; new ones come because the robot's agent continues.
    assert eventually(lambda: root.page(mine).one(LF.deliveryState) == LF.active, "active again")
    assert len(receiver.log(method="POST")) >= count
    assert root.http.delete(mine).status_code == 204


def test_a_bad_file_leaves_everything_as_it_was(own: AuthenticatedGateway, root: Browser) -> None:
    assert own.gateway is not None
    own.write("[[token")
    own.gateway.said("the identities stay as they were")
    assert root.http.get(own.root).status_code == 200
    own.write()
    own.add("after", *ALL)
    own.known("after")


@pytest.mark.parametrize("text", [None, "[[token", '[[token]]\nname = "a"\n'])
def test_a_gateway_does_not_start_with_a_bad_file(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "identities.toml"
    if text is not None:
        file.write_text(text)
    with process(*Place(tmp_path).command(), "--identities", str(file)) as gateway:
        assert gateway.ended() == 1
        (line,) = [each for each in gateway.lines if each.startswith("gateway: ")]
        assert str(file) in line and "Traceback" not in gateway.output


def test_a_subtree_subscription_needs_the_right_for_all_readable_robots(
    own: AuthenticatedGateway, issuer: Issuer
) -> None:
    """Otherwise it would reveal robots to which the caller may not subscribe."""
    grant = '[[issuer.grant]]\nclaim = "groups"\nvalue = "visitors"\n'
    own.tables["issuer"] += grant + 'scopes = ["read"]\n' + grant + 'scopes = ["subscribe"]\nrobots = ["lab-*"]\n'
    own.write()
    bearer = f"Bearer {issuer.token(sub='eve', groups=['visitors'])}"
    with httpx.Client(timeout=20, headers={"authorization": bearer}) as eve:
        assert eventually(lambda: eve.get(own.root).status_code == 200, "eve known")
        for path, status in (("?depth=subtree", 403), ("", 200), ("lab-1/?depth=subtree", 200), ("hall-1/", 403)):
            with eve.stream("GET", own.root + path, headers={"accept": "text/event-stream"}) as response:
                assert response.status_code == status, path


def test_a_subtree_subscription_is_opened_with_the_right_that_it_needs(
    own: AuthenticatedGateway, issuer: Issuer
) -> None:
    """Its creator may have had more rights than the one who opens it: the same person with another token."""
    grant = '[[issuer.grant]]\nclaim = "groups"\nvalue = "{}"\n'
    some = grant.format("guests") + 'scopes = ["read"]\n' + grant.format("guests")
    some += 'scopes = ["subscribe"]\nrobots = ["lab-*"]\n'
    own.tables["issuer"] += some + grant.format("guides") + 'scopes = ["subscribe"]\n'
    own.write()
    body = _PREFIXES + f"[] a hybrit:Subscription ; hybrit:onResource <{own.root}> ; lf:depth lf:wholeSubtree ."

    def bearer(*groups: str) -> dict[str, str]:
        return {"authorization": f"Bearer {issuer.token(sub='mia', groups=['guests', *groups])}"}

    with httpx.Client(timeout=20) as mia:
        assert eventually(lambda: mia.get(own.root, headers=bearer()).status_code == 200, "mia known")
        made = mia.post(own.root + "subscriptions", content=body, headers=_TURTLE | bearer("guides"))
        assert made.status_code == 201, made.text
        events = {"accept": "text/event-stream"}
        for groups, status in (((), 403), (("guides",), 200)):
            with mia.stream("GET", made.headers["location"], headers=events | bearer(*groups)) as response:
                assert response.status_code == status, groups


def test_subscriptions_are_counted_by_creator(own: AuthenticatedGateway, root: Browser) -> None:
    """Not by address, which is the same for all of them here."""
    own.add("eager", "read", "subscribe")
    own.add("modest", "read", "subscribe")
    own.known("modest")
    container = str(root.part(SEEN, "wrist_3_joint").one(HYBRIT.subscriptions))
    body = _PREFIXES + f"[] a hybrit:Subscription ; hybrit:onResource <{_joint(root)}> ."

    def subscribe(name: str) -> int:
        with own.browsing(name) as browser:
            return browser.http.post(container, content=body, headers=_TURTLE).status_code

    assert [subscribe("eager") for _ in range(9)] == [201] * 8 + [429]
    assert subscribe("modest") == 201


_READS_ALL = """
[[issuer]]
url = "https://issuer.example"
audience = "fleet"
[[issuer.grant]]
scopes = ["read"]
"""


@pytest.mark.parametrize(("robots", "ends"), [('["*"]', False), ('["lab-*"]', True)])
async def test_a_stream_of_the_fleet_ends_with_the_right_to_some_of_its_robots(
    tmp_path: Path, robots: str, ends: bool
) -> None:
    """Its client still reads all robots, and may subscribe to some: not to all that the stream has."""
    file = tmp_path / "identities.toml"
    before = _READS_ALL + '[[issuer.grant]]\nscopes = ["subscribe"]\n'
    file.write_text(before)
    ended = asyncio.Event()
    async with Identities(file) as identities:
        caller = identities.identity_of(Claims("https://issuer.example", "ann", frozenset(), 2**62))
        assert caller is not None
        with identities.watch_rights(caller, None, ended.set, lambda: True):
            identities.roster = parse_roster(before + f"robots = {robots}\n", tmp_path)
            identities.end_revoked()
            assert ended.is_set() == ends
