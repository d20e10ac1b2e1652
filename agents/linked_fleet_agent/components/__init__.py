"""Components of robots, for authors of drivers: classes whose values, actions and events the fleet gets to know."""

from linked_fleet_agent.components.call import Call as Call
from linked_fleet_agent.components.call import CancelledActionError as CancelledActionError
from linked_fleet_agent.components.component import Component as Component
from linked_fleet_agent.components.component import action as action
from linked_fleet_agent.components.component import event as event
from linked_fleet_agent.components.component import value as value
from linked_fleet_agent.components.schemas import DeclarationError as DeclarationError
from linked_fleet_agent.components.schemas import term as term
from linked_fleet_agent.components.schemas import unit as unit
from linked_fleet_agent.wire.components import BASE as BASE
