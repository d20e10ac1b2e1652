"""Forms from SHACL shapes."""

from pyoxigraph import NamedNode

from gateway.face.values import Facts


def form_of_action(facts: Facts, iri: NamedNode) -> object:
    return None


def form_of_setting(facts: Facts, iri: NamedNode) -> object:
    return None


def form_of_subscription(container: str, owner: str) -> object:
    return None
