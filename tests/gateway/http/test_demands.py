"""Demands that a handler does not honour are refused."""

import pytest

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.http.demands import refuse_demands
from linked_fleet_gateway.resources.affordance import EVERYTHING, NOTHING, Demand, honoured_by

_FIELDS = {
    Demand.DRY_RUN: {b"prefer": b"dry-run"},
    Demand.RESPONSE: {b"prefer": b"handling=strict, respond-async"},
    Demand.IDEMPOTENCY_KEY: {b"idempotency-key": b"1"},
    Demand.LOCK_TOKEN: {b"lock-token": b"<urn:uuid:1>"},
    Demand.PRECONDITIONS: {b"if-none-match": b"*"},
    Demand.OTHER_PRECONDITIONS: {b"if": b"(<urn:uuid:1>)"},
}


@pytest.mark.parametrize("demand", Demand)
def test_a_demand_is_refused_unless_it_is_honoured(demand: Demand) -> None:
    refuse_demands(_FIELDS[demand], EVERYTHING)
    refuse_demands(_FIELDS[demand], frozenset({demand}))
    for honours in (NOTHING, EVERYTHING - {demand, Demand.OTHER_PRECONDITIONS}):
        with pytest.raises(FleetError, match=r"Nothing has changed\.") as refusal:
            refuse_demands(_FIELDS[demand], honours)
        assert refusal.value.status in (400, 412)


def test_an_affordance_without_a_declaration_honours_nothing() -> None:
    assert honoured_by(object()) == NOTHING
