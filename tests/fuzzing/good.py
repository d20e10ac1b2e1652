"""Valid messages and bodies as seeds: mutants reach the code behind the parsers only if they pass them."""

import json
from random import Random
from typing import Any

from fake_robots import SIMPLE, joint, link, robot
from linked_fleet_agent.wire.codec import encode, encode_state, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Base, Description, State
from linked_fleet_rdf.vocabulary import PREFIXES

ARM = robot(
    link("base"), link("upper"), link("cart"), link("wheel"), link("finger"), link("tip", inertial=False),
    joint("pan", "revolute", "base", "upper"),
    joint("slide", "prismatic", "upper", "cart"),
    joint("roll", "continuous", "cart", "wheel"),
    joint("grip", "revolute", "wheel", "finger", '<mimic joint="pan" multiplier="0.5" offset="0.1"/>'),
    joint("glue", "fixed", "finger", "tip"),
)  # fmt: skip
JOINTS = ("pan", "slide", "roll", "grip")
URDFS = ((ARM, JOINTS), (SIMPLE, ("elbow",)))
POSE = (
    '<> lf:namedPose [ dcterms:title "up" ; '
    "lf:target [ lf:ofJoint <pan> ; vom:numericalValue 0.5 ; vom:unit unit:RAD ] ] ."
)
TURTLE_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
NAMES = ("arm", "toy", "arm 2/left", "pose", "..", "é", "x" * 128)


def description(random: Random, name: str, incarnation: int) -> Description:
    urdf, joints = random.choice(URDFS)
    floating = random.random() < 0.3
    return Description(
        version=WIRE_VERSION, robot=name, incarnation=incarnation, title="An arm", urdf=urdf, joints=joints,
        rate_hz=100,
        base="floating" if floating else "fixed", capabilities=("move", "follow", "stop"),
        annotations=TURTLE_PREFIXES + POSE if random.random() < 0.2 else "", layout=layout(len(joints), floating),
    )  # fmt: skip


def able_arm(incarnation: int) -> Description:
    """Return an arm with a named pose that accepts every kind of action."""
    return Description(
        version=WIRE_VERSION, robot="arm", incarnation=incarnation, title="An arm", urdf=ARM, joints=JOINTS,
        rate_hz=100, annotations=TURTLE_PREFIXES + POSE, capabilities=("move", "follow", "stop"),
        layout=layout(len(JOINTS), False),
    )  # fmt: skip


def frame(random: Random, joints: int, floating: bool, incarnation: int, sequence: int) -> bytes:
    rows = [tuple(random.uniform(-1, 1) for _ in range(joints)) for _ in range(3)]
    at, still = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    base = Base(at, (*still, 1.0), still, still) if floating else None
    state = State(
        incarnation=incarnation, sequence=sequence, monotonic_ns=random.randrange(2**40),
        wall_ns=random.randrange(2**60),
        base=base, positions=rows[0], velocities=rows[1], efforts=rows[2],
    )  # fmt: skip
    return encode_state(state)


def command(random: Random, id: str, incarnation: int, now_ns: int) -> dict[str, Any]:
    """Return a command as a JSON object, for the joints of ARM."""
    if random.random() < 0.6:
        motion: dict[str, Any] = {"type": "move", "targets": {"pan": random.uniform(-1, 1)}, "speeds": {"pan": 1.0}}
        if random.random() < 0.5:
            motion["targets"] |= {"slide": random.uniform(-1, 1), "roll": random.uniform(-3, 3)}
    else:
        joints = random.choice((["pan"], ["pan"], ["pan", "roll"]))
        times = [2.5 * (number + 1) for number in range(random.randint(1, 6))]
        rows = [[random.uniform(-0.1, 0.1) for _ in joints] for _ in times]
        motion = {"type": "follow", "joints": joints, "times_s": times, "positions": rows}
    return {
        "version": WIRE_VERSION, "id": id, "incarnation": incarnation, "seen_ns": now_ns, "time_to_live_ns": 10**9,
        "motion": motion, "scale": random.choice((1.0, 0.5)), "rehearsal": random.random() < 0.1,
        "expects": {"pan": {"position": 0.0, "tolerance": 10.0}} if random.random() < 0.3 else {},
    }  # fmt: skip


def stop(random: Random, id: str) -> dict[str, Any]:
    return {
        "version": WIRE_VERSION, "id": id, "joints": random.choice(([], ["pan"], ["grip"], ["pan", "roll"])),
        "command": random.choice(("", "", id)), "reason": "enough", "rehearsal": random.random() < 0.1,
    }  # fmt: skip


def reply(random: Random, id: str) -> dict[str, Any]:
    if random.random() < 0.5:
        return {"type": "accepted", "id": id, "duration_s": 1.5, "preempts": ["a-1"], "at_ns": 12}
    return {"type": "refused", "id": id, "code": random.choice(("stale", "limits", "fault")), "reason": "no"}


def progress(random: Random, id: str, incarnation: int) -> dict[str, Any]:
    state = random.choice(("running", "running", "succeeded", "failed", "cancelled", "preempted"))
    return {
        "version": WIRE_VERSION, "id": id, "incarnation": incarnation, "state": state, "wall_ns": 10**18, "reason": "",
        "positions": {"pan": 0.25}, "progress": 0.5, "successor": "",
    }  # fmt: skip


def tree_of(message: Description) -> dict[str, Any]:
    made: dict[str, Any] = json.loads(encode(message))
    return made


# -- bodies, by the last segment of where they go -------------------------------------------------------------------

_SCALAR = "vom:numericalValue {0} ; vom:unit {1}"
_RAD, _METRE, _MILLI = (_SCALAR.format(*each) for each in ((0.3, "unit:RAD"), (0.2, "unit:M"), (12, "unit:MilliM")))
_MORE = "; lf:precondition [ lf:ofJoint </arm/pan> ; vom:numericalValue 0 ; vom:unit unit:RAD ; lf:tolerance 10 ]"
_SPEED = "; lf:speed [ vom:numericalValue 1 ; vom:unit unit:RAD-PER-SEC ]"
_TARGET = f"lf:target [ lf:ofJoint </arm/pan> ; {_RAD} ] , [ lf:ofJoint </arm/slide> ; {_METRE} ]"
_POINT = "maths:x 300 ; maths:y 0.5 ; maths:z 100"
BODIES = {
    "rotate": f"<> {_RAD} {_SPEED} {_MORE} .",
    "rotateBy": f"<> {_RAD} {_SPEED} .",
    "translate": f"<> {_METRE} {_MORE} .",
    "translateBy": f"<> {_MILLI} .",
    "moveJoints": f"<> {_TARGET} ; lf:speedScale 0.5 {_MORE} .",
    "followTrajectory": f"<> lf:waypoint [ lf:atTime 1 ; {_TARGET} ] , [ lf:atTime 2.5 ; {_TARGET} ] .",
    "reach": f"<> lf:ofLink </arm/wheel> ; lf:position [ {_POINT} ; vom:unit unit:MilliM ] ; lf:frame 'base' ; "
    "lf:orientation [ maths:x 0 ; maths:y 0 ; maths:z 0 ; lf:w 1 ] .",
    "assumePose": '<> lf:poseName "up" ; lf:speedScale 1 .',
    "title": '<> lf:value "An arm" .',
    "annotations": '<./> rdfs:label "Arm"@en ; rdfs:seeAlso [ rdfs:label "x" ] .',
    "maximumSpeedScale": "<> lf:value [ vom:numericalValue 0.7 ] .",
    "targetRotation": f"<> lf:value [ {_RAD} ] .",
    "targetTranslation": f"<> lf:value [ {_METRE} ] .",
    "lease": '<> lf:holder "me" ; lf:leaseDuration 5 .',
    "subscriptions": "[] a hybrit:Subscription , hybrit:WebCallback ; hybrit:onResource </arm/pan/rotation> ; "
    'hybrit:callbackURL "http://localhost:9/x" ; hybrit:mediaType "text/turtle" ; lf:depth lf:withProperties ; '
    'lf:minimumInterval 0.5 ; lf:deadband 0.01 ; lf:secret "whsec_MDEyMzQ1Njc4OTAxMjM0NTY3ODkwMTIzNDU2Nzg5MDE=" .',
}
TERMS = (
    "lf:unknown", "unit:RAD", "unit:DEG", "unit:M", "unit:MilliM", "vom:Degree", "maths:Scalar", "0", "1", "-1",
    "1e400", "1e6",
    '"NaN"^^xsd:double', '"INF"^^xsd:float', "0.1", "0.3", "9" * 4000, '"1_0"^^xsd:integer', '"x"^^xsd:double',
    '"300"^^xsd:byte',
    "true", '"text"', '"x"@en', '"x"@en--ltr', '""', f'"{"x" * 5000}"', "<>", "<#x>", "<a b>", "<urn:x>", "</arm/pan>",
    "</arm/slide>", "</arm/grip>", "</arm/nothing>", "</toy/elbow>", "</arm/>", "</arm/wheel>",
    "<http://example.org/arm/pan>",
    "</arm/pan/rotation>", "</>", "[]", "()", "( 1 2 3 )", "( " + "1 " * 1100 + ")",
    "[ lf:reason " * 40 + "1" + " ]" * 40, "_:a",
    "a", "lf:value", "lf:target", "lf:ofJoint", "lf:speedScale", "lf:atTime", "lf:waypoint", "vom:numericalValue",
    "vom:unit",
    "rdf:first", "rdf:rest", "rdf:nil", "sh:NodeShape", "lf:holder", "nobody:knows", ";", ".", ",", "[", "]", "(",
    ")", "^^",
    "<< <> lf:reason 1 >>", "{| lf:reason 2 |}", "@prefix x: <y> .", "@base <urn:x> .", "# ", "'''", "\\u0000",
    '"\\uD800"',
    "hybrit:callbackURL", "hybrit:onResource", "lf:secret", '"http://127.0.0.1:9/x"', '"ftp://localhost/"',
    '"application/ld+json"',
)  # fmt: skip
