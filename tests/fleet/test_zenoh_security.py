"""With certificates a robot acts only for itself, and only gateways command: with and without a router."""

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import zenoh

from browser import Browser
from certificates import made
from commanding import PAN, STILL_RAD, WRIST, angle, begun, moving, of_joint, put, radian, slowly
from fake_robots import FakeRobot, real_session
from linked_fleet_agent.wire.codec import encode
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Stop
from linked_fleet_agent.wire.trust import mutual_tls
from linked_fleet_state.answers import read_reply
from running import Process, eventually, free_port, process
from small_fleet import live, presence

pytestmark = pytest.mark.processes
KEYS = Keys()
FORGED, HONEST = b"forged", b"honest"
_ASK_S = 5.0
_ROUND_S = 2.0  # of questions that are repeated until all have answered


def tls_of(folder: Path, who: str) -> dict[str, object]:
    return mutual_tls(*(str(folder / name) for name in ("ca.pem", f"{who}.pem", f"{who}.key")))


def words(folder: Path, who: str, prefix: str = "--") -> tuple[str, ...]:
    files = {"ca": "ca.pem", "cert": f"{who}.pem", "key": f"{who}.key"}
    return tuple(word for flag, name in files.items() for word in (f"{prefix}{flag}", str(folder / name)))


def linked(endpoint: str, tls: dict[str, object]) -> contextlib.AbstractContextManager[zenoh.Session]:
    """Open a client session; zenoh.ZError if it is not accepted."""
    settings = {"connect/endpoints": [endpoint], "connect/timeout_ms": 2000, "transport/link/tls": tls}
    return real_session({"mode": "client", **settings})


@dataclass
class Scene:
    """A fleet whose robot is called a, and sessions of friendly and hostile clients."""

    folder: Path
    endpoint: str
    browser: Browser

    def linked(self, who: str) -> contextlib.AbstractContextManager[zenoh.Session]:
        return linked(self.endpoint, tls_of(self.folder, who))

    def agent(self, *more: str) -> contextlib.AbstractContextManager[Process]:
        return process("-m", "linked_fleet_agent", "--connect", self.endpoint, *more)


@contextlib.contextmanager
def hub(folder: Path, by_router: bool) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the endpoint for agents, and the gateway's arguments for it."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    made(folder, "--agent", "a,b,c", "--listen", endpoint, "--gateway", "127.0.0.1")
    if by_router:
        with process("tests/support/zenoh_router.py", str(folder / "router.json5")) as router:
            router.said("routing")
            yield endpoint, ("--zenoh-connect", endpoint)
    else:
        yield endpoint, ("--zenoh-listen", endpoint, "--zenoh-access", str(folder / "access.json"))


@pytest.fixture(
    scope="module",
    params=[pytest.param(True, id="router", marks=pytest.mark.test_all), pytest.param(False, id="gateway")],
)
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    folder = tmp_path_factory.mktemp("wire")
    port = free_port()
    with hub(folder, request.param) as (endpoint, told):
        command = ("--port", str(port), "--state-dir", str(folder / "state"), *told)
        with (
            process("-m", "linked_fleet_gateway", *command, *words(folder, "gateway", "--zenoh-")) as gateway,
            contextlib.closing(Browser(f"http://127.0.0.1:{port}/")) as browser,
        ):
            gateway.said("serving")
            here = Scene(folder, endpoint, browser)
            with here.agent("--robot=a=ur5", *words(folder, "agents/a")):
                live(browser, "a")
                yield here


# -- those who are who they say -------------------------------------------------------------------------------------


def test_a_robot_with_its_certificate_moves(scene: Scene) -> None:
    begun(put(scene.browser, of_joint(scene.browser, WRIST, robot="a"), radian(0.3), prefer="wait=30"))
    assert angle(scene.browser, WRIST, "a") == pytest.approx(0.3, abs=STILL_RAD)


def test_another_robot_joins_with_its_own(scene: Scene) -> None:
    """What other tests see refused is not refused because nothing works."""
    with scene.linked("agents/b") as session:
        FakeRobot(session, "b").appear().stand(0.5)
        live(scene.browser, "b")


# -- an impostor: the certificate of b ------------------------------------------------------------------------------


def test_an_agent_cannot_publish_as_another_robot(scene: Scene) -> None:
    """Neither state nor progress; what it then publishes about itself arrives, so that would have arrived before."""
    with scene.linked("gateway") as gateway, scene.linked("agents/b") as impostor:
        heard: list[tuple[str, bytes]] = []
        kept = [
            gateway.declare_subscriber(key, lambda said: heard.append((str(said.key_expr), said.payload.to_bytes())))
            for key in (KEYS.all_states, KEYS.all_progress)
        ]
        eventually(lambda: heard, "frames of a")

        def both() -> bool:
            for robot, payload in (("a", FORGED), ("b", HONEST)):
                impostor.put(KEYS.robot(robot, "state"), payload)
                impostor.put(KEYS.robot(robot, "progress"), payload)
            honest = {key for key, payload in list(heard) if payload == HONEST}
            return honest == {KEYS.robot("b", "state"), KEYS.robot("b", "progress")}

        eventually(both, "what it says of itself")
        assert FORGED not in {payload for _, payload in heard}
        assert len(kept) == 2


def test_robots_hear_the_heartbeat_of_gateways_alone(scene: Scene) -> None:
    """That of the fleet's gateway arrives, and one sent by a robot in its name does not."""
    with scene.linked("agents/c") as robot, scene.linked("agents/b") as impostor:
        heard: list[tuple[str, bytes]] = []
        kept = robot.declare_subscriber(
            KEYS.all_heartbeats, lambda said: heard.append((str(said.key_expr), said.payload.to_bytes()))
        )
        eventually(lambda: heard, "a heartbeat")
        for key in (heard[0][0], KEYS.heartbeat("evil")):
            impostor.put(key, FORGED)
        before = len(heard)
        eventually(lambda: len(heard) > before + 1, "heartbeats after the forged ones")
        assert {payload for _, payload in heard} == {b""}
        kept.undeclare()


def test_an_agent_cannot_answer_for_another_robot(scene: Scene) -> None:
    """Neither questions to the other robot, nor, with the other's key, questions to itself."""
    kinds = ("description", "command", "stop")
    with scene.linked("gateway") as gateway, scene.linked("agents/b") as impostor:
        theirs, own = ([KEYS.robot(robot, kind) for kind in kinds] for robot in "ab")  # type: ignore[arg-type]
        forged: set[tuple[str, bytes]] = set()

        def deceive(query: zenoh.Query, of_a: str, of_b: str) -> None:
            query.reply(of_a, FORGED)
            query.reply(of_b, HONEST)

        kept = []
        for of_a, of_b in zip(theirs, own, strict=True):
            kept.append(impostor.declare_queryable(of_a, lambda query, key=of_a: query.reply(key, FORGED)))
            kept.append(impostor.declare_queryable(of_b, lambda query, keys=(of_a, of_b): deceive(query, *keys)))

        def all_answer() -> bool:
            asked = [
                gateway.get(
                    key,
                    target=zenoh.QueryTarget.ALL,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=_ROUND_S,
                    payload=b"{}",
                )
                for key in (*theirs, *own, *map(KEYS.all_of_kind, kinds))
            ]
            found = {(str(each.ok.key_expr), each.ok.payload.to_bytes()) for said in asked for each in said if each.ok}
            forged.update(each for each in found if each[1] == FORGED)
            honest = {(key, HONEST) for key in own}
            return honest <= found and set(theirs) <= {key for key, _ in found}

        eventually(all_answer, "answers of both robots")
        assert not forged
        assert len(kept) == 2 * len(kinds)


def test_an_agent_cannot_declare_tokens_of_others(scene: Scene) -> None:
    """A token of a later run would take over the robot, one of a gateway would make robots move without any."""
    with scene.linked("gateway") as gateway, scene.linked("agents/c") as robot, scene.linked("agents/b") as impostor:
        late = 2**62
        forged = (KEYS.presence("a", late), KEYS.gateway("evil"))
        kept = [impostor.liveliness().declare_token(key) for key in (*forged, KEYS.presence("b", late))]

        def seen() -> set[str] | None:
            found = _tokens(gateway, KEYS.all_presence) | _tokens(robot, KEYS.all_gateways)
            return found if KEYS.presence("b", late) in found else None

        found = eventually(seen, "its own token")
        assert not found & set(forged)
        assert any(key.startswith("fleet/gateway/") for key in found), "the real one is seen"
        assert len(kept) == 3
    assert presence(scene.browser, "a") is not None


def _tokens(session: zenoh.Session, key: str) -> set[str]:
    return {str(each.ok.key_expr) for each in session.liveliness().get(key, timeout=_ASK_S) if each.ok}


_STOP = encode(Stop(version=WIRE_VERSION, id="9c4c3a6e", reason="a test"))


def _stopped(session: zenoh.Session) -> list[type]:
    """Return robot a's replies to a stop."""
    replies = session.get(KEYS.robot("a", "stop"), timeout=_ASK_S, payload=_STOP)
    return [type(read_reply(each.ok.payload.to_bytes(), "9c4c3a6e")[0]) for each in replies if each.ok]


def test_nobody_but_gateways_commands(scene: Scene) -> None:
    """A robot keeps moving if another robot requests a stop, and stops for a gateway."""
    begun(put(scene.browser, of_joint(scene.browser, PAN, robot="a"), slowly(angle(scene.browser, PAN, "a") + 1.5)))
    moving(scene.browser, PAN, "a")
    with scene.linked("gateway") as gateway, scene.linked("agents/b") as impostor:
        replies: list[zenoh.Reply] = []
        for key in (KEYS.robot("a", "stop"), KEYS.all_stops, KEYS.robot("a", "command"), "fleet/**"):
            impostor.get(key, replies.append, target=zenoh.QueryTarget.ALL, timeout=_ASK_S, payload=_STOP)
        kept = impostor.liveliness().declare_token(KEYS.presence("b", 1))
        eventually(lambda: _tokens(gateway, KEYS.all_presence_of_robot("b")), "what it said after it had asked")
        moving(scene.browser, PAN, "a")
        assert [reply for reply in replies if reply.ok] == []
        assert _stopped(gateway) == [Accepted]
        kept.undeclare()


def test_an_agent_receives_no_commands_of_another_robot(scene: Scene) -> None:
    with scene.linked("gateway") as gateway, scene.linked("agents/b") as impostor:
        spied: list[str] = []
        kept = [impostor.declare_subscriber(key, lambda said: spied.append(str(said.key_expr)))
                for key in (KEYS.robot("a", "state"), "fleet/**", "**")]  # fmt: skip
        own = impostor.liveliness().declare_token(KEYS.presence("b", 1))
        eventually(lambda: _tokens(gateway, KEYS.all_presence_of_robot("b")), "what it said after it had asked")
        heard: list[bytes] = []
        subscriber = gateway.declare_subscriber(KEYS.robot("a", "state"), lambda said: heard.append(said.payload))
        eventually(lambda: len(heard) > 20, "frames at the gateway")
        assert spied == []
        del kept, own, subscriber


# -- those who are nobody -------------------------------------------------------------------------------------------


@pytest.mark.test_all
def test_without_a_certificate_of_the_authority_there_is_no_link(scene: Scene, tmp_path: Path) -> None:
    """Without a certificate, with a foreign one, or without TLS, the agent hears nothing and its robot is missing."""
    foreign = made(tmp_path / "foreign", "--agent", "c")
    ours, theirs = words(scene.folder, "agents/c"), words(foreign, "agents/c")
    nothing = mutual_tls(str(scene.folder / "ca.pem"), "", "")
    for tls in ({"root_ca_certificate": nothing["root_ca_certificate"]}, tls_of(foreign, "agents/c")):
        with pytest.raises(zenoh.ZError), linked(scene.endpoint, tls):
            pass
    plain = scene.endpoint.replace("tls/", "tcp/")
    refused = (theirs, (*ours[:2], *theirs[2:]), (*theirs[:2], *ours[2:]), ("--connect", plain))
    with contextlib.ExitStack() as stack:
        for agent in [stack.enter_context(scene.agent("--robot=c=ur5", *more)) for more in refused]:
            agent.said("no answer from")
            assert presence(scene.browser, "c") is None
    with scene.agent("--robot=c=ur5", *ours):
        live(scene.browser, "c")


def test_a_robot_takes_no_other_for_its_router(tmp_path: Path) -> None:
    """A robot's certificate is not valid for listening: a listener could command all who connect."""
    folder = made(tmp_path / "wire", "--agent", "a,b")
    endpoint = f"tls/127.0.0.1:{free_port()}"
    trap = json.loads((folder / "router.json5").read_text())
    trap |= {"listen": {"endpoints": [endpoint]}, "access_control": {"enabled": False}}
    trap["transport"]["link"]["tls"] = tls_of(folder, "agents/b")
    (folder / "trap.json5").write_text(json.dumps(trap))
    with process("tests/support/zenoh_router.py", str(folder / "trap.json5")) as router:
        router.said("routing")
        with process(
            "-m", "linked_fleet_agent", "--robot=a=ur5", "--connect", endpoint, *words(folder, "agents/a")
        ) as agent:
            agent.said("no answer from")
            with pytest.raises(zenoh.ZError), linked(endpoint, tls_of(folder, "agents/a")):
                pass


def test_a_robot_that_listens_obeys_gateways_alone(tmp_path: Path) -> None:
    folder = made(tmp_path / "wire", "--agent", "a@127.0.0.1,b")
    endpoint = f"tls/127.0.0.1:{free_port()}"
    listening = ("--robot=a=ur5", "--connect", "", "--listen", endpoint)
    with process("-m", "linked_fleet_agent", *listening, *words(folder, "agents/a")) as agent:
        agent.said("connected")
        with linked(endpoint, tls_of(folder, "gateway")) as gateway:
            token = gateway.liveliness().declare_token(KEYS.gateway("g"))
            eventually(lambda: _stopped(gateway), "an answer to a gateway")
            with linked(endpoint, tls_of(folder, "agents/b")) as impostor:
                assert _stopped(impostor) == []
            assert _stopped(gateway) == [Accepted]
            token.undeclare()
