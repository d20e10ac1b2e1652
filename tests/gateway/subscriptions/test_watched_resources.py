"""Listeners of the live fleet."""

from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_state.invocations import Invocation, InvocationState
from virtual.zenoh_network import ZenohNetwork


def test_listeners_hear_of_each_change_of_an_invocation_until_they_are_removed() -> None:
    live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
    heard: list[InvocationState] = []

    def hear(invocation: Invocation) -> None:
        heard.append(invocation.state)

    one = Invocation("1", "r", "/r/actions/stop", {}, 0, 1)
    live.mark_invocation_changed(one)
    live.add_invocation_listener(hear)
    live.add_invocation_listener(hear)
    for state in (InvocationState.RUNNING, InvocationState.FAILED):
        one.state = state
        live.mark_invocation_changed(one)
    live.remove_invocation_listener(hear)
    live.remove_invocation_listener(hear)
    live.mark_invocation_changed(one)
    assert heard == [InvocationState.RUNNING, InvocationState.FAILED]
