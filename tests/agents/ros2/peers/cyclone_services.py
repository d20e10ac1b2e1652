"""Services and an action that are framed as rmw_cyclonedds frames them, relayed to those of rclpy.

Requests and responses begin with 16 bytes: the client and a number. Fast DDS has both in the header of RTPS instead, so
the bridge, which is written for Cyclone DDS, reaches no service of rclpy. There is no wheel of rmw_cyclonedds. Here
real Cyclone DDS meets the bridge, and rclpy's own servers decide.
"""

# mypy: disable-error-code=call-arg

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from action_msgs.msg import GoalStatusArray
from action_msgs.srv import CancelGoal
from cyclonedds.core import Entity, Listener, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, int8, int32, int64, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger
from test_msgs.action import Fibonacci

RELIABLE = (Policy.Reliability.Reliable(10**9), Policy.DataRepresentation(use_cdrv0_representation=True))
SERVICE = Qos(*RELIABLE, Policy.History.KeepLast(10))
LATCHED = Qos(*RELIABLE, Policy.History.KeepLast(1), Policy.Durability.TransientLocal)


@dataclass
class Request(IdlStruct):
    """A request or response: who asked, and the how many'th question that was."""

    client: uint64
    number: int64


@dataclass
class Empty(Request, typename="std_srvs.srv.dds_.Trigger_Request_"):
    structure_needs_at_least_one_member: uint8


@dataclass
class Told(Request, typename="std_srvs.srv.dds_.Trigger_Response_"):
    success: bool
    message: str


@dataclass
class Switch(Request, typename="std_srvs.srv.dds_.SetBool_Request_"):
    data: bool


@dataclass
class Switched(Request, typename="std_srvs.srv.dds_.SetBool_Response_"):
    success: bool
    message: str


@dataclass
class Time(IdlStruct):
    sec: int32
    nanosec: uint32


@dataclass
class Uuid(IdlStruct):
    uuid: array[uint8, 16]


@dataclass
class GoalInfo(IdlStruct):
    goal_id: Uuid
    stamp: Time


@dataclass
class Sequence(IdlStruct):
    sequence: sequence[int32]


@dataclass
class Order(IdlStruct):
    order: int32


@dataclass
class SendGoal(Request, typename="test_msgs.action.dds_.Fibonacci_SendGoal_Request_"):
    goal_id: Uuid
    goal: Order


@dataclass
class Accepted(Request, typename="test_msgs.action.dds_.Fibonacci_SendGoal_Response_"):
    accepted: bool
    stamp: Time


@dataclass
class GetResult(Request, typename="test_msgs.action.dds_.Fibonacci_GetResult_Request_"):
    goal_id: Uuid


@dataclass
class Ended(Request, typename="test_msgs.action.dds_.Fibonacci_GetResult_Response_"):
    status: int8
    result: Sequence


@dataclass
class Cancel(Request, typename="action_msgs.srv.dds_.CancelGoal_Request_"):
    goal_info: GoalInfo


@dataclass
class Cancelling(Request, typename="action_msgs.srv.dds_.CancelGoal_Response_"):
    return_code: int8
    goals_canceling: sequence[GoalInfo]


@dataclass
class Feedback(IdlStruct, typename="test_msgs.action.dds_.Fibonacci_FeedbackMessage_"):
    goal_id: Uuid
    feedback: Sequence


@dataclass
class Status(IdlStruct):
    goal_info: GoalInfo
    status: int8


@dataclass
class Statuses(IdlStruct, typename="action_msgs.msg.dds_.GoalStatusArray_"):
    status_list: sequence[Status]


@dataclass
class Gid(IdlStruct):
    data: array[uint8, 16]


@dataclass
class NodeInfo(IdlStruct):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeInfo]


class Relay:
    """A node ``cyclone_services`` of a participant of Cyclone DDS, that offers what ``node`` offers below ``inner``."""

    def __init__(self, node: Node, domain: int, inner: str) -> None:
        self.node, self.inner = node, inner
        self.participant = DomainParticipant(domain)
        self.readers: list[Entity] = []
        self.writers: list[Entity] = []
        self._offer()
        self._announce()

    def _offer(self) -> None:
        self.service("home", Trigger, Empty, Told)
        self.service("set_lamp", SetBool, Switch, Switched)
        self.service("silence", Trigger, Empty, Told)
        parts = Fibonacci.Impl
        self.service("fibonacci/_action/send_goal", parts.SendGoalService, SendGoal, Accepted)
        self.service("fibonacci/_action/get_result", parts.GetResultService, GetResult, Ended)
        self.service("fibonacci/_action/cancel_goal", CancelGoal, Cancel, Cancelling)
        self.topic("fibonacci/_action/feedback", parts.FeedbackMessage, Feedback, SERVICE)
        self.topic("fibonacci/_action/status", GoalStatusArray, Statuses, LATCHED)

    def service(self, name: str, type_: Any, asked: type[Request], told: type[Request]) -> None:
        client = self.node.create_client(type_, f"{self.inner}/{name}")
        answers = self._writer(f"rr/{name}Reply", told, SERVICE)

        def relay(request: Request) -> None:
            calls = client.call_async(_to_ros(request, type_.Request(), skip=2))
            calls.add_done_callback(lambda call: answers.write(_to_dds(call.result(), told, request)))

        self._reader(f"rq/{name}Request", asked, relay)

    def topic(self, name: str, type_: Any, told: type[IdlStruct], quality: Qos) -> None:
        writer = self._writer(f"rt/{name}", told, quality)
        self.node.create_subscription(type_, f"{self.inner}/{name}", lambda said: writer.write(_to_dds(said, told)), 10)

    def _writer(self, topic: str, type_: type[IdlStruct], quality: Qos) -> DataWriter:
        writer = DataWriter(self.participant, Topic(self.participant, topic, type_), qos=quality)
        self.writers.append(writer)
        return writer

    def _reader(self, topic: str, type_: type[IdlStruct], take: Callable[[Any], None]) -> None:
        class Taking(Listener):
            def on_data_available(self, reader: DataReader) -> None:
                for said in reader.take(10):
                    if isinstance(said, type_):
                        take(said)

        topic_ = Topic(self.participant, topic, type_)
        self.readers.append(DataReader(self.participant, topic_, qos=SERVICE, listener=Taking()))

    def _announce(self) -> None:
        """Tell what is of one node, as each participant of ROS does."""
        topic = Topic(self.participant, "ros_discovery_info", ParticipantInfo)
        info = NodeInfo("/", "cyclone_services", _gids(self.readers), _gids(self.writers))
        self.told = DataWriter(self.participant, topic, qos=LATCHED)
        self.told.write(ParticipantInfo(Gid(list(self.participant.guid.bytes)), [info]))


def _gids(entities: list[Entity]) -> list[Gid]:
    return [Gid(list(each.guid.bytes)) for each in entities]


def _to_ros(said: IdlStruct, message: Any, skip: int = 0) -> Any:
    """Return the message with the members of ``said`` behind the first ``skip``."""
    for each in fields(said)[skip:]:
        value = getattr(said, each.name)
        if is_dataclass(value):
            _to_ros(value, getattr(message, each.name))
        elif hasattr(message, each.name):
            setattr(message, each.name, list(value) if isinstance(value, bytes) else value)
    return message


def _to_dds(message: Any, type_: Any, request: Request | None = None) -> Any:
    """Return the message as an instance of ``type_``, a response if ``request`` is given."""
    head = [request.client, request.number] if request else []
    return type_(*head, *(_plain(getattr(message, each.name), each.type) for each in fields(type_)[len(head) :]))


def _plain(value: Any, type_: Any) -> Any:
    if is_dataclass(type_):
        return _to_dds(value, type_)
    if hasattr(value, "__len__") and not isinstance(value, str):
        inner = getattr(type_, "__metadata__", None)
        inner = inner[0].subtype if inner else None
        return [_plain(each, inner) if is_dataclass(inner) else int(each) for each in value]
    return value
