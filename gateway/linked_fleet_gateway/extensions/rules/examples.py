"""Examples on the page of rules; those for the demo can be saved unchanged."""

from dataclasses import dataclass

_LF = "PREFIX lf: <https://w3id.org/linked-fleet#>\n"


@dataclass(frozen=True)
class Example:
    """An example. ``invokes`` is the path of an action, ``body`` Turtle about ``_:body``, its input."""

    title: str
    comment: str
    condition: str
    invokes: str
    body: str = ""
    told_apart_by: str = ""


UPRIGHT = Example(
    "The UR5 stands up when its wrist turns too far",
    "Turn wrist_3_joint of the UR5 beyond 1 rad (57°) to see it fire.",
    _LF
    + """PREFIX ros: <http://ros.org/#>
PREFIX spatial: <http://vocab.arvida.de/2015/06/spatial/vocab#>
PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#>
SELECT ?joint ?angle WHERE {
  BIND(</ur5/wrist_3_joint> AS ?joint)
  ?joint ros:rotation/spatial:rotationAngle/vom:numericalValue ?angle .
  FILTER(?angle > 1)
}
""",
    "/ur5/actions/assumePose",
    """@prefix lf: <https://w3id.org/linked-fleet#> .

_:body lf:poseName "upright" .
""",
    "joint",
)
GREET = Example(
    "The Panda opens its hand when the UR5 moves",
    "Move any joint of the UR5 to see it fire, once for each motion.",
    _LF
    + """SELECT ?task WHERE {
  </ur5/> lf:currentTask ?task .
}
""",
    "/panda/panda_finger_joint1/actions/translate",
    """@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix unit: <http://qudt.org/vocab/unit/> .

_:body vom:numericalValue 0.04 ; vom:unit unit:M .
""",
)
KEEP_AWAY = Example(
    "The UR5 stops when it comes near to the Panda",
    "Bring the tool of the UR5 nearer than 0.4 m to the hand of the Panda to see it fire. It is no safety function.",
    _LF
    + """SELECT ?tool WHERE {
  BIND(</ur5/tool0> AS ?tool)
  FILTER(lf:distance(?tool, </panda/panda_hand>) < 0.4)
}
""",
    "/ur5/actions/stop",
)
EXAMPLES = (UPRIGHT, GREET, KEEP_AWAY)
