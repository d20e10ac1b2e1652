"""One gateway with authentication and two robots."""

from collections.abc import Iterator

import pytest

from authenticated_gateway import ALL, SEEN, AuthenticatedGateway, run_authenticated
from issuer import Issuer, issuing

LAB = ("lab-*",)


@pytest.fixture(scope="module")
def issuer() -> Iterator[Issuer]:
    with issuing() as one:
        yield one


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory, issuer: Issuer) -> Iterator[AuthenticatedGateway]:
    """Tokens are named by their rights; ``lab`` has all of them for one robot, ``all`` for both."""
    with run_authenticated(tmp_path_factory.mktemp("guarded"), issuer=issuer) as one:
        one.add("all", *ALL)
        one.add("lab", *ALL, robots=LAB)
        one.add("reader", "read")
        one.add("subscriber", "read", "subscribe")
        one.add("stopper", "read", "stop")
        one.add("actor", "read", "act")
        one.add("admin", "read", "admin")
        one.add("scraper", "admin")
        one.add("button", "stop", robots=LAB)
        one.add("lab-subscriber", "read", "subscribe", robots=LAB)
        one.add("over", *ALL, expires="2020-01-01T00:00:00Z")
        one.known("lab-subscriber")
        yield one


__all__ = ["LAB", "SEEN"]
