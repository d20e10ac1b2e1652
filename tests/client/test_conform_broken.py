"""The conformance checker, with a server that has one fault at a time."""

import pytest

from linked_fleet_client.conform.protocol import security
from linked_fleet_client.conform.verdict import Level, Outcome
from tests.client.test_conform_server import BLUEPRINT, WITH_BLUEPRINT, check, outcomes, replaced, serving

pytestmark = pytest.mark.virtual
BROKEN: list[tuple[str, dict[str, str], set[str]]] = [
    ("http-1.0", {}, {"R0.1", "R0.12", "R0.15"}),
    ("no-host", {}, {"R0.1"}),
    ("head-with-body", {}, {"R0.1"}),
    ("dead property", replaced("/t", "</p/1>", "</p/1>, </p/2>"), {"R0.3", "R0.9", "R1.9"}),
    ("property without URI", replaced("/t", "</p/1>", "</p/1>, [ a hybrit:Property ]"), {"R0.3", "R1.9"}),
    ("describes another", replaced("/t", "<> a", "</elsewhere> a"), {"R0.3", "R1.9", "R1.10"}),
    ("root-500", {}, {"R0.4", "R0.5", "R0.6", "R1.2"}),
    ("property-405", {}, {"R0.5", "R1.9"}),
    ("no-put", {}, {"R0.5"}),
    ("broken-500", {}, {"R0.6"}),
    ("nonsense", {}, {"R0.6"}),
    ("delete-200", {}, {"R0.7"}),
    ("no-location", {}, {"R0.8"}),
    ("no-link", {}, {"R0.9"}),
    ("some-links", {}, {"R0.9"}),
    ("no-options", {}, {"R0.10"}),
    ("no-allow", {}, {"R0.10"}),
    ("no-etag", {}, {"R0.11"}),
    ("bare-etag", {}, {"R0.11"}),
    ("no-head-etag", {}, {"R0.11"}),
    ("no-304", {}, {"R0.11"}),
    ("no-websocket", {}, {"R0.12", "R0.15"}),
    ("wrong-key", {}, {"R0.12", "R0.15"}),
    ("no-pong", {}, {"R0.12"}),
    ("no-callback", {}, {"R0.16"}),
    ("no-upgrade", {}, {"R0.12", "R0.14", "R0.15", "R0.16"}),
    ("any-callback", {}, {"R0.16"}),
    ("no-negotiation", {}, {"R0.17"}),
    ("html", {}, {"R1.2"}),
    ("garbage", {}, {"R1.2", "R1.9", "R1.10"}),
    ("untyped", replaced("/t", "a hybrit:RoboticThing, ldp:RDFSource ;", ""), {"R1.3"}),
    ("own title", replaced("/t", "dcterms:title", "ex:title"), {"R1.5"}),
    ("inference", replaced("/s/2", "ldp:Container, ", ""), {"R1.7"}),
    ("no subscriptions", replaced("/", "hybrit:subscriptions </s/1> ;", ""), {"R1.8"}),
    ("no container", replaced("/s/1", "ldp:Container, ldp:BasicContainer", "hybrit:List"), {"R1.8"}),
    ("no properties", replaced("/t", "hybrit:property </p/1> ;", ""), {"R1.9"}),
    ("no actions", replaced("/t", "hybrit:action </a/1>", "dcterms:subject </a/1>"), {"R1.10"}),
    ("does not conform", {**WITH_BLUEPRINT, "/b": BLUEPRINT.replace("dcterms:title", "dcterms:date")}, {"R1.11"}),
    ("dead blueprint", {"/t": WITH_BLUEPRINT["/t"]}, {"R0.3", "R0.9", "R1.11"}),
]


@pytest.mark.parametrize(("flaw", "pages", "broken"), BROKEN, ids=[flaw for flaw, _, _ in BROKEN])
def test_each_flaw_is_found_and_only_it(flaw: str, pages: dict[str, str], broken: set[str]) -> None:
    """The violated requirement is named, and no other."""
    with serving({flaw}, pages) as server:
        assert outcomes(check(server.root), Outcome.FAILED) == broken


@pytest.mark.parametrize("flaw", ["no-etag", "no-link", "no-upgrade", "nonsense"])
def test_a_broken_must_breaks_the_report(flaw: str) -> None:
    with serving({flaw}, {}) as server:
        assert check(server.root).violates_must


def test_a_broken_should_does_not() -> None:
    with serving({"delete-200"}, {}) as server:
        report = check(server.root)
        assert outcomes(report, Outcome.FAILED) == {"R0.7"}
        assert not report.violates_must


@pytest.mark.parametrize(
    ("url", "outcome", "level"),
    [
        ("https://198.51.100.1/", Outcome.PASSED, None),
        ("http://127.0.0.1:8000/", Outcome.INAPPLICABLE, None),
        ("http://[::1]/", Outcome.INAPPLICABLE, None),
        ("http://10.0.0.1/", Outcome.FAILED, None),
        ("http://8.8.8.8/", Outcome.FAILED, Level.MUST),
    ],
)
def test_plain_http_is_judged_by_where_it_is_reached(url: str, outcome: Outcome, level: Level | None) -> None:
    verdict = security(url)
    assert (verdict.outcome, verdict.level) == (outcome, level)
