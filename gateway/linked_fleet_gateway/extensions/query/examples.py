"""Example queries for the page of the endpoint and README.md; tests run them on a real fleet."""

from dataclasses import dataclass

_PREFIXES = """PREFIX lf: <https://w3id.org/linked-fleet#>
PREFIX ros: <http://ros.org/#>
PREFIX dcterms: <http://purl.org/dc/terms/>
PREFIX spatial: <http://vocab.arvida.de/2015/06/spatial/vocab#>
PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#>
PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
"""


@dataclass(frozen=True)
class Example:
    title: str
    comment: str
    body: str

    @property
    def text(self) -> str:
        """The query with the prefixes that it uses."""
        lines = _PREFIXES.splitlines(keepends=True)
        return "".join(each for each in lines if each.split()[1] in self.body) + self.body


POSITIONS = Example(
    "Where every joint stands",
    "Positions (rad, m) and limits of all joints: numbers, which the page draws over the rows.",
    """SELECT ?robot ?joint ?position ?lower ?upper WHERE {
  ?of a lf:Robot ; dcterms:title ?robot .
  ?part dcterms:isPartOf ?of ; dcterms:title ?joint ; ros:rotation|lf:translation ?value .
  ?value (spatial:rotationAngle|lf:displacement)/vom:numericalValue ?position .
  OPTIONAL {
    ?part lf:limits ?limits .
    ?limits lf:lowerLimit/vom:numericalValue ?lower ; lf:upperLimit/vom:numericalValue ?upper .
  }
} ORDER BY ?robot ?joint
""",
)
NEAR_LIMITS = Example(
    "Joints above 80 % of a limit",
    "Of the whole fleet: joints that stand beyond 80 % of their upper limit, or of their lower one.",
    """SELECT ?robot ?joint ?position ?lower ?upper WHERE {
  ?of dcterms:title ?robot .
  ?part dcterms:isPartOf ?of ; dcterms:title ?joint ; lf:limits ?limits ; ros:rotation|lf:translation ?value .
  ?value (spatial:rotationAngle|lf:displacement)/vom:numericalValue ?position .
  ?limits lf:lowerLimit/vom:numericalValue ?lower ; lf:upperLimit/vom:numericalValue ?upper .
  FILTER(?upper > 0 && ?position > 0.8 * ?upper || ?lower < 0 && ?position < 0.8 * ?lower)
} ORDER BY ?robot ?joint
""",
)
REACH = Example(
    "Whose hand can reach a point",
    "Links called hand or gripper whose origin the joints can bring to (0.5, 0.2, 0.4) m from the root of their robot.",
    """SELECT ?robot ?link WHERE {
  ?of a lf:Robot ; dcterms:title ?robot ; dcterms:hasPart ?link .
  ?link a ros:Link ; dcterms:title ?name .
  FILTER(REGEX(?name, "hand$|gripper$|tool0$"))
  FILTER(lf:canReach(?link, 0.5, 0.2, 0.4))
} ORDER BY ?robot ?link
""",
)
MOVING = Example(
    "What moves now, and who asked for it",
    "Invocations that are under way, how far they are, and whose they are.",
    """SELECT ?robot ?action ?done ?who WHERE {
  ?of lf:currentTask ?task ; dcterms:title ?robot .
  ?task rdfs:seeAlso ?action ; lf:progress/vom:numericalValue ?done .
  OPTIONAL { ?task prov:wasAssociatedWith/dcterms:title ?who }
} ORDER BY ?robot
""",
)
EXAMPLES = (POSITIONS, NEAR_LIMITS, REACH, MOVING)
