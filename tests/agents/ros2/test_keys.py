"""The names that rmw_zenoh gives to topics, nodes and their ends, against its docs/design.md."""

from zenoh import ext

from linked_fleet_agent.robots.ros2 import session
from linked_fleet_agent.robots.ros2.session import Node, Topic

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"


def test_the_key_of_a_topic() -> None:
    plain = Topic(0, "/chatter", "std_msgs/msg/String", HASH)
    assert plain.key == f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
    spaced = Topic(2, "/robot1/chatter", "std_msgs/msg/String", HASH)
    assert spaced.key == f"2/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"


def test_the_tokens_of_a_node_and_of_what_it_has() -> None:
    chatter = Topic(2, "/chatter", "std_msgs/msg/String", HASH)
    listener = Node(2, "aac3178e146ba6f1fc6e6a4085e77f21", "listener")
    assert listener.token == "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    assert listener.token_of(10, "MS", chatter, "::,10:,:,:,,") == (
        "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/%chatter/"
        f"std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,"
    )
    spaced = Topic(2, "/robot1/chatter", "std_msgs/msg/String", HASH)
    assert "/MP/%/%/listener/%robot1%chatter/" in listener.token_of(1, "MP", spaced, session.KEEP_LAST_ONE)


def test_the_attachment_is_what_zenoh_serialises() -> None:
    """Number, time and identifier by zenoh's serialiser, with which rmw_zenoh reads and writes them."""
    gid = bytes(range(16))
    assert session.attachment(5, 6, gid) == ext.z_serialize((ext.Int64(5), ext.Int64(6), gid)).to_bytes()
