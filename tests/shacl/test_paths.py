"""The values reached by paths of compiled shapes; pySHACL is compared."""

import pytest

from shacl_findings import EX, compiled_finds, pyshacl_finds, turtle

_BODY = """ex:body ex:p ex:a , ex:b ; ex:q ex:c .
    ex:a ex:p ex:c ; ex:q ex:b . ex:b ex:q ex:d . ex:c ex:p ex:body , ex:c . ex:d ex:q ex:e . ex:x ex:p ex:body ."""


def _reached(path: str) -> set[str]:
    """Return the local names of the value nodes, none of which is a literal; each causes one violation."""
    shape, body = turtle(f"ex:Shape sh:property [ sh:path {path} ; sh:nodeKind sh:Literal ] ."), turtle(_BODY)
    found = compiled_finds(shape, EX.Shape, body, EX.body)
    assert found == pyshacl_finds(shape, EX.Shape, body, EX.body)
    return {value.rpartition("/")[2] for _, _, value, _ in found}


@pytest.mark.parametrize(
    ("path", "reached"),
    [
        ("ex:p", "a b"),
        ("ex:none", ""),
        ("[ sh:inversePath ex:p ]", "c x"),
        ("[ sh:inversePath ex:q ]", ""),
        ("( ex:p ex:q )", "b d"),
        ("( ex:p ex:q ex:q )", "d e"),
        ("( [ sh:inversePath ex:p ] ex:p )", "body c"),
        ("[ sh:alternativePath ( ex:p ex:q ) ]", "a b c"),
        ("[ sh:alternativePath ( ex:none ex:q ( ex:p ex:p ) ) ]", "c"),
        ("[ sh:zeroOrOnePath ex:p ]", "body a b"),
        ("[ sh:zeroOrOnePath ( ex:p ex:q ) ]", "body b d"),
        ("[ sh:zeroOrMorePath ex:p ]", "body a b c"),
        ("[ sh:oneOrMorePath ex:p ]", "a b c body"),
        ("[ sh:zeroOrMorePath ex:q ]", "body c"),
        ("[ sh:oneOrMorePath ex:q ]", "c"),
        ("[ sh:oneOrMorePath ex:none ]", ""),
        ("( ex:p [ sh:zeroOrMorePath ex:q ] )", "a b d e"),
        ("[ sh:oneOrMorePath [ sh:alternativePath ( ex:p ex:q ) ] ]", "a b c d e body"),
    ],
)
def test_a_path_leads_to_each_node_once(path: str, reached: str) -> None:
    """Cycles included: c refers to itself and to the body."""
    assert _reached(path) == set(reached.split())


@pytest.mark.parametrize(
    ("path", "count"),
    [
        ("( ex:p ex:p )", 1),
        ("( ex:p [ sh:alternativePath ( ex:p ex:q ) ] )", 1),
        ("[ sh:alternativePath ( ex:p ex:r ) ]", 3),
        ("[ sh:zeroOrOnePath ex:r ]", 3),
        ("[ sh:zeroOrMorePath ex:r ]", 3),
    ],
)
def test_a_node_that_two_ways_lead_to_is_one_value(path: str, count: int) -> None:
    """Both a and b lead to b, by p and by q, and the body to itself."""
    body = turtle("""ex:body ex:p ex:a , ex:b ; ex:r ex:body , ex:a , ex:b .
        ex:a ex:p ex:b ; ex:q ex:b . ex:b ex:p ex:b ; ex:q ex:b .""")
    for most in (count - 1, count):
        shape = turtle(f"ex:Shape sh:property [ sh:path {path} ; sh:maxCount {most} ] .")
        found = compiled_finds(shape, EX.Shape, body, EX.body)
        assert (len(found), found) == (count - most, pyshacl_finds(shape, EX.Shape, body, EX.body))


_SHARED = """ex:Shape sh:node ex:Part ; sh:property [ sh:path ex:p ; sh:node ex:Part ; sh:property [
    sh:path ex:p ; sh:node ex:Part ] ] , [ sh:path _:path ; sh:maxCount 2 ] , [ sh:path _:path ; sh:minCount 1 ] .
    ex:Part sh:property [ sh:path _:path ; sh:nodeKind sh:IRI ] . _:path sh:zeroOrMorePath ex:q ."""


@pytest.mark.parametrize(
    ("body", "violations"),
    [
        ("ex:body ex:q ex:a ; ex:p ex:b . ex:b ex:q ex:c ; ex:p ex:d .", 0),
        ("ex:body ex:q 1 ; ex:p ex:b . ex:b ex:q ex:c .", 1),
        ("ex:body ex:p ex:b . ex:b ex:q 1 ; ex:p ex:d . ex:d ex:q 2 .", 2),
        ("ex:body ex:q ex:a , ex:b ; ex:p [ ex:q [ ] ] .", 2),
    ],
)
def test_shapes_and_paths_may_be_shared(body: str, violations: int) -> None:
    """At one depth and at several: sharing is no recursion."""
    shapes, triples = turtle(_SHARED), turtle(body)
    found = compiled_finds(shapes, EX.Shape, triples, EX.body)
    assert found == pyshacl_finds(shapes, EX.Shape, triples, EX.body)
    assert len(found) == violations


@pytest.mark.parametrize(("least", "most"), [(0, 0), (1, 1), (2, 2), (0, 2)])
def test_values_are_counted_by_a_shape_with_properties(least: int, most: int) -> None:
    shapes = turtle(f"""ex:Shape sh:property [ sh:path ex:p ; sh:qualifiedMinCount {least} ;
        sh:qualifiedMaxCount {most} ; sh:qualifiedValueShape [ sh:property [ sh:path ex:q ; sh:maxCount 1 ;
        sh:property [ sh:path ex:p ; sh:minCount 1 ] ] ] ] .""")
    good, bad = "[ ex:q [ ex:p 1 ] ]", "[ ex:q [ ex:q 1 ] ]"
    for values, count in (([bad], 0), ([good, bad], 1), ([good, good, bad], 2), ([good] * 3, 3)):
        body = turtle(f"ex:body ex:p {' , '.join(values)} .")
        found = compiled_finds(shapes, EX.Shape, body, EX.body)
        assert found == pyshacl_finds(shapes, EX.Shape, body, EX.body)
        assert bool(found) == (not least <= count <= most)
