import pytest

from linked_fleet_valkey import server as embedded
from redis_backends import pytest_pyfunc_call, server, valkey, valkey_cluster  # noqa: F401 - fixtures and a hook
from running import PATIENCE_S


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for the embedded server however long its start takes."""
    monkeypatch.setattr(embedded, "_OPENING_S", PATIENCE_S)
