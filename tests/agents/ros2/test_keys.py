"""The keys and tokens of both transports, against docs/design.md of rmw_zenoh and the tokens that bridges declare."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from zenoh import ext

from linked_fleet_agent.robots.ros2.graph import Interface, Offer
from linked_fleet_agent.robots.ros2.transports import (
    HUMBLE_HASH,
    KEEP_LAST_ONE,
    LATCHED,
    DdsBridge,
    RmwZenoh,
    attachment,
)

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
ZID = "aac3178e146ba6f1fc6e6a4085e77f21"
CHATTER = Interface("/chatter", "std_msgs/msg/String")
SPACED = Interface("/robot1/chatter", "std_msgs/msg/String")
TRIGGER = Interface("/lights/on", "std_srvs/srv/Trigger")
LISTENER, BRIDGE = RmwZenoh(2, ZID, "listener"), DdsBridge()


def test_the_key_of_a_topic_and_of_a_service() -> None:
    assert LISTENER.key(CHATTER, HASH) == f"2/chatter/std_msgs::msg::dds_::String_/{HASH}"
    assert LISTENER.key(SPACED, HASH) == f"2/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"
    assert LISTENER.key(TRIGGER, "") == "2/lights/on/std_srvs::srv::dds_::Trigger_/*"
    assert BRIDGE.key(SPACED, HASH) == "robot1/chatter"


def test_the_tokens_of_a_node_and_of_what_it_has() -> None:
    assert LISTENER.node_token == f"@ros2_lv/2/{ZID}/0/0/NN/%/%/listener"
    assert LISTENER.token(10, "subscription", CHATTER, HASH, "::,10:,:,:,,") == (
        f"@ros2_lv/2/{ZID}/0/10/MS/%/%/listener/%chatter/std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,"
    )
    assert "/MP/%/%/listener/%robot1%chatter/" in LISTENER.token(1, "publisher", SPACED, HASH, KEEP_LAST_ONE)


def test_the_attachment_is_what_zenoh_serialises() -> None:
    """Number, time and identifier by zenoh's serialiser, with which rmw_zenoh reads and writes them."""
    gid = bytes(range(16))
    assert attachment(5, 6, gid) == ext.z_serialize((ext.Int64(5), ext.Int64(6), gid)).to_bytes()


OTHER = RmwZenoh(2, "1234567890abcdef1234567890abcdef", "talker")


@pytest.mark.parametrize(
    ("token", "offers"),
    [
        (OTHER.token(3, "publisher", SPACED, HASH, KEEP_LAST_ONE), [Offer("publisher", SPACED, HASH, key_hash=HASH)]),
        (OTHER.token(3, "publisher", CHATTER, HASH, LATCHED), [Offer("publisher", CHATTER, HASH, True, HASH)]),
        (
            OTHER.token(4, "service", TRIGGER, HUMBLE_HASH, "::,:,:,:,,"),
            [Offer("service", TRIGGER, key_hash=HUMBLE_HASH)],
        ),
        (
            OTHER.token(5, "subscription", CHATTER, HASH, "2:2:1,10:,:,:,,"),
            [Offer("subscription", CHATTER, HASH, key_hash=HASH)],
        ),
        (OTHER.node_token, []),
        (LISTENER.token(3, "publisher", SPACED, HASH, KEEP_LAST_ONE), []),  # the driver itself
        (OTHER.token(3, "publisher", SPACED, HASH, KEEP_LAST_ONE).replace("/2/", "/3/", 1), []),  # another domain
        (OTHER.token(3, "publisher", SPACED, "RIHS01_12", KEEP_LAST_ONE), []),
        (OTHER.token(3, "publisher", SPACED, HASH, ":"), []),
        (OTHER.token(3, "publisher", Interface("/a b", "std_msgs/msg/String"), HASH, KEEP_LAST_ONE), []),
        (OTHER.token(3, "publisher", Interface("/a" * 200, "std_msgs/msg/String"), HASH, KEEP_LAST_ONE), []),
        (OTHER.token(3, "publisher", Interface("/a", "Std/msg/String"), HASH, KEEP_LAST_ONE), []),
        ("@ros2_lv/2/a/0/1/MP/%/%/n/%a/std_msgs::msg::dds_::String_", []),
    ],
)
def test_tokens_of_rmw_zenoh_say_what_a_node_offers(token: str, offers: list[Offer]) -> None:
    assert list(LISTENER.offers_of(token)) == offers


@pytest.mark.parametrize(
    ("token", "offers"),
    [
        ("MP/robot1§chatter/std_msgs§msg§String/::1:0,1", [Offer("publisher", SPACED, latched=True)]),
        (f"MP/chatter/std_msgs§msg§String/:1::0,1:typehash={HASH};", [Offer("publisher", CHATTER, HASH)]),
        ("MS/chatter/std_msgs§msg§String/K:::", [Offer("subscription", CHATTER)]),
        ("SS/lights§on/std_srvs§srv§Trigger", [Offer("service", TRIGGER)]),
        ("SC/lights§on/std_srvs§srv§Trigger", [Offer("client", TRIGGER)]),
        (
            "AS/arm§go/pkg§action§Go",
            [
                Offer("service", Interface("/arm/go/_action/send_goal", "pkg/action/Go_SendGoal")),
                Offer("service", Interface("/arm/go/_action/get_result", "pkg/action/Go_GetResult")),
                Offer("service", Interface("/arm/go/_action/cancel_goal", "action_msgs/srv/CancelGoal")),
                Offer("publisher", Interface("/arm/go/_action/feedback", "pkg/action/Go_FeedbackMessage")),
                Offer(
                    "publisher", Interface("/arm/go/_action/status", "action_msgs/msg/GoalStatusArray"), latched=True
                ),
            ],
        ),
        ("AC/arm§go/pkg§action§Go", []),
        ("MP/chatter/std_msgs§msg§String", []),
        ("MP/chatter/std_msgs§msg§String/::", []),
        ("SS/lights§on/std_srvs§srv§Trigger/:::", []),
        ("SS/lights on/std_srvs§srv§Trigger", []),
        ("", []),
    ],
)
def test_tokens_of_a_bridge_say_what_its_side_offers(token: str, offers: list[Offer]) -> None:
    assert list(BRIDGE.offers_of(f"@/{ZID}/@ros2_lv/{token}".rstrip("/"))) == offers


_PIECES = st.sampled_from(["@ros2_lv", "2", "MP", "SS", "%", "a", "@", "§", "AS"])


@given(st.one_of(st.text(max_size=60), st.lists(_PIECES).map("/".join)))
def test_no_token_is_more_than_ignored(token: str) -> None:
    for transport in (LISTENER, BRIDGE):
        assert all(isinstance(each, Offer) for each in transport.offers_of(token))
