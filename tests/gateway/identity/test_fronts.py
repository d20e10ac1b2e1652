"""Logins behind a proxy: an address with many failures must wait, and nobody else."""

from collections.abc import Iterator

import httpx
import pytest

from authenticated_gateway import AuthenticatedGateway, run_authenticated
from issuer import Issuer
from linked_fleet_gateway.extensions.sessions.login import FAILURES

pytestmark = pytest.mark.virtual


@pytest.fixture(scope="module")
def fronted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    """Yield a gateway that trusts this machine, its proxy, to state the addresses of clients."""
    with run_authenticated(tmp_path_factory.mktemp("fronted"), "--fronts=127.0.0.1", robots=False) as one:
        yield one


def _log_in(here: AuthenticatedGateway, token: str, client: str) -> int:
    headers = {"origin": here.root[:-1], "x-forwarded-for": f"198.51.100.200, {client}"}
    return httpx.post(here.root + "login", data={"token": token}, headers=headers).status_code


def test_failures_behind_a_front_count_for_the_client_and_not_for_the_front(fronted: AuthenticatedGateway) -> None:
    assert [_log_in(fronted, f"guess{n}", "192.0.2.7") for n in range(FAILURES)] == [401] * FAILURES
    assert _log_in(fronted, "guess", "192.0.2.7") == 429
    assert _log_in(fronted, "guess", "192.0.2.8") == 401
    assert _log_in(fronted, fronted.tokens["root"], "192.0.2.8") == 303


def test_forged_addresses_do_not_change_rate_limits(here: AuthenticatedGateway) -> None:
    statuses = [_log_in(here, f"guess{n}", f"192.0.2.{n}") for n in range(FAILURES + 1)]
    assert statuses[-1] == 429


def test_a_correct_credential_is_taken_however_many_failed_from_its_address(here: AuthenticatedGateway) -> None:
    """Many people may share an address, and somebody guessing among them locks nobody out."""
    for n in range(2 * FAILURES):
        _log_in(here, f"guess{n}", "192.0.2.7")
    assert _log_in(here, "guess", "192.0.2.7") == 429
    assert _log_in(here, here.tokens["all"], "192.0.2.7") == 303
    assert _log_in(here, "guess", "192.0.2.7") == 429  # a successful login gives a guesser no new attempts


def test_a_login_at_an_issuer_works_however_many_failed_from_its_address(
    here: AuthenticatedGateway, issuer: Issuer
) -> None:
    returned = here.root + "login/return?code=x&state=y"
    statuses = [httpx.get(returned).status_code for _ in range(FAILURES + 1)]
    assert statuses[-1] == 429
    with httpx.Client(follow_redirects=True) as browser:
        page = browser.get(here.root + "login/start?issuer=plant", headers={"accept": "text/turtle"})
    assert page.status_code == 200 and page.url == here.root
