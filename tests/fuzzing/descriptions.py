"""Descriptions of robots: real and small ones, mutated, through the one reader and all whom it passes them on to."""

import math
import re
from functools import cache
from random import Random

import pinocchio as pin

from descriptions_of_robots import INERTIAL, LIMIT, arm, joint, link
from fuzzing import mutation
from fuzzing.findings import Tally, in_process
from linked_fleet_agent.robots.catalogue import data_folder
from linked_fleet_agent.robots.mujoco_model import build
from linked_fleet_agent.urdf import RobotModel, UrdfError, decode, joints_of
from linked_fleet_agent.urdf.writer import plain_urdf
from linked_fleet_gateway.extensions.models.geometry import urdf_with_mesh_addresses
from linked_fleet_state.pinocchio_model import MAX_DEGREES

_REAL = (
    "ur_description/urdf/ur5_robot.urdf",
    "panda_description/urdf/panda.urdf",
    "go2_description/urdf/go2.urdf",
    "iris_description/robots/iris_simple.urdf",
    "double_pendulum_description/urdf/double_pendulum.urdf",
)
_SHAPE = '<collision><origin xyz="0 0 0.1" quat_xyzw="0 0 0 1"/><geometry><{}/></geometry></collision>'
_FORMS = ('box size="1 1 1"', 'sphere radius="1"', 'cylinder radius="1" length="2"', 'capsule radius="1" length="2"')
_SMALL = (
    arm(),
    arm(f'<origin xyz="0 0 1" quat_xyzw="0 0 0 1"/>{LIMIT}', attributes=' version="1.1" xmlns="http://www.ros.org"'),
    arm(upper=INERTIAL + "".join(_SHAPE.format(form) for form in _FORMS)),
    arm(
        f'<safety_controller soft_lower_limit="-1" soft_upper_limit="1"/><dynamics damping="1" friction="1"/>{LIMIT}',
        more=link("x") + joint("m", "tool", "x", f'{LIMIT}<mimic joint="j1" multiplier="2" offset="0.1"/>'),
    ),
    arm(
        more=link("x") + joint("f", "tool", "x", "", kind="floating") + link("y") + joint("p", "x", "y", kind="planar")
    ),
)
_WORDS = (
    "", " ", "nan", "inf", "-inf", "1e308", "1.7976931348623157e308", "-1", "0", "0 0 0", "1 1 1", "0 0 0 1", "1e-300",
    "1e300 0 0", "1,5", "0, 0, 1", "${x}", "$(find y)", "2.0", "1.1", "j1", "base", "upper ", "world", "é", "\u2028",
    "fixed", "floating", "continuous", "revolute", "prismatic", "spherical", "package://a/b.stl", "x" * 200,
)  # fmt: skip
_ELEMENT = re.compile(r"<(\w+)(?:\s[^<>]*)?/>")
_ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-be", "latin-1", "cp1252")
_SIMULATED = 0.02  # share; the simulation is a hundred times slower than the reader


def run(count: int, seed: int, first: int = 0) -> Tally:
    return in_process("descriptions", count, seed, first, lambda: take)


@cache
def _seeds() -> tuple[str, ...]:
    return *_SMALL, *((data_folder() / path).read_text() for path in _REAL)


def take(random: Random) -> None:
    """Pass one description to agent, gateway, pages and Pinocchio, and some to MuJoCo."""
    content = _encoded(random, _mutated(random))
    try:
        urdf = decode(content)
        model = RobotModel.for_urdf(urdf)
    except UrdfError as error:
        assert 10 < len(str(error)) < 1000, error
        return
    _check_model(model)
    plain = plain_urdf(model)
    _check_same(model, RobotModel.parse(plain))
    RobotModel.parse(urdf_with_mesh_addresses(urdf, {}).decode())
    if sum(1 if each.movable else 6 for each in model.joints.values()) <= MAX_DEGREES:
        pin.buildModelFromXML(plain_urdf(model, shapes=False))
    if random.random() < _SIMULATED:
        build(urdf, "r", joints_of(urdf), {}, random.random() < 0.5, None)


def _check_model(model: RobotModel) -> None:
    for one in model.joints.values():
        assert (
            one.refusal
            or one.mimic
            or one.unranged
            or None not in (one.limits.lower, one.limits.upper)
            or not _ranged(one.kind)
        )
        assert all(math.isfinite(part) for part in (*one.axis, *one.origin.position_m, *one.origin.orientation_xyzw))
        assert math.hypot(*one.origin.orientation_xyzw) == math.inf or abs(math.hypot(*one.axis) - 1) < 1e-9
        assert one.mimic is None or model.joints[one.mimic.joint].movable
    for each in model.findings:
        assert each.sentence.endswith(".") and len(each.sentence) < 1000, each
        assert each.about == "robot" or each.name in (model.joints if each.about == "joint" else model.links)


def _ranged(kind: str) -> bool:
    return kind in ("revolute", "prismatic")


def _check_same(model: RobotModel, again: RobotModel) -> None:
    """Check that what others read is what we have read."""
    assert list(model.joints) == list(again.joints) and list(model.links) == list(again.links)
    for old, new in zip(model.joints.values(), again.joints.values(), strict=True):
        assert (old.kind, old.parent, old.child, old.mimic) == (new.kind, new.parent, new.child, new.mimic)
        turned = sum(a * b for a, b in zip(old.origin.orientation_xyzw, new.origin.orientation_xyzw, strict=True))
        assert abs(abs(turned) - 1) < 1e-9 and old.origin.position_m == new.origin.position_m
        assert old.stops == new.stops or not old.movable or None in old.stops or old.mimic or old.stops == (0, 0)


def _mutated(random: Random) -> str:
    text = random.choice(_seeds())
    for _ in range(random.choice((0, 1, 1, 2, 3, 6))):
        text = random.choice((_with_other_value, _with_other_value, _with_other_value, _with_other_element))(
            random, text
        )
    return text


def _with_other_value(random: Random, text: str) -> str:
    pieces = text.split('"')
    if len(pieces) < 3:
        return text
    at = random.randrange(1, len(pieces), 2)
    pieces[at] = random.choice((*_WORDS, *map(str, mutation.NUMBERS), pieces[random.randrange(1, len(pieces), 2)]))
    return '"'.join(pieces)


def _with_other_element(random: Random, text: str) -> str:
    """Drop, repeat or move an element without content."""
    found = [match.span() for match in _ELEMENT.finditer(text)]
    if not found:
        return text
    (start, end), (other, _) = random.choice(found), random.choice(found)
    element = text[start:end]
    dropped = text[:start] + text[end:]
    return random.choice((dropped, text[:start] + element + text[start:], text[:other] + element + text[other:]))


def _encoded(random: Random, text: str) -> bytes:
    encoding = random.choice(_ENCODINGS) if random.random() < 0.2 else "utf-8"
    content = text.encode(encoding, "replace")
    return mutation.raw(random, content) if random.random() < 0.1 else content
