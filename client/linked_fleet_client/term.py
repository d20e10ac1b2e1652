"""RDF literals from values that people and programs provide."""

import math
import re
from datetime import datetime
from decimal import Decimal
from typing import Any

from rdflib.term import Literal, URIRef

from linked_fleet_client.quantity import INTEGERS
from linked_fleet_client.vocabulary import XSD, local_name

# The first datatype that the shape allows is used. Decimals keep the given value exactly, which matters at limits: the
# double nearest to 0.8 is more than 0.8.
_WHOLE = (XSD.integer, XSD.decimal, XSD.double, XSD.float)
_BROKEN = (XSD.decimal, XSD.double, XSD.float)
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_WORDS = {"true": True, "false": False}


def literal(value: Any, datatypes: tuple[URIRef, ...], scale: float = 1.0, numeric: bool = False) -> Literal:
    """Return ``value``, a number multiplied by ``scale``, as a literal of one of ``datatypes`` (any if empty).

    ``numeric`` says that it is a number although no datatype says so. Raises ValueError with the valid forms.
    """
    takes_numbers = any(_is_numeric(datatype) for datatype in datatypes) or (numeric and not datatypes)
    if takes_numbers and not isinstance(value, bool) and (number := _number(value)) is not None:
        return _numeral(number if scale == 1.0 else number * scale, datatypes)
    if isinstance(value, int | float) and not datatypes:
        return Literal(value) if isinstance(value, bool) else _numeral(value, datatypes)
    if XSD.boolean in datatypes and (value := _WORDS.get(str(value).lower(), value)) in (True, False):
        return Literal(bool(value))
    if isinstance(value, datetime):
        return Literal(value)
    if not datatypes and not numeric:
        return Literal(str(value))
    for datatype in datatypes:
        if not _is_numeric(datatype) and datatype != XSD.boolean:
            return _checked(str(value), datatype)
    raise ValueError(f"{str(value)[:80]!r} is no {_said(datatypes)}")


def _checked(text: str, datatype: URIRef) -> Literal:
    found = Literal(text, datatype=datatype)
    if found.ill_typed:
        raise ValueError(f"{text[:80]!r} is no {_said((datatype,))}")
    return found


def _number(value: Any) -> float | int | None:
    if isinstance(value, int | float | Decimal):
        return value if isinstance(value, int) else float(value)
    text = str(value).strip()
    if not _NUMBER.fullmatch(text):
        return None
    return int(text) if text.lstrip("+-").isdigit() and len(text) < 30 else float(text)


def _numeral(number: float | int, datatypes: tuple[URIRef, ...]) -> Literal:
    if not math.isfinite(number):
        raise ValueError(f"{number} is no finite number")
    whole = isinstance(number, int) or number.is_integer()
    order = (*(_WHOLE if whole else _BROKEN), *(sorted(INTEGERS) if whole else ()))
    offered = [datatype for datatype in order if datatype in datatypes or not datatypes]
    if not offered:
        raise ValueError(f"{number:.9g} is no {_said(datatypes)}")
    return _checked(_lexical(number, offered[0]), offered[0])


def _lexical(number: float | int, datatype: URIRef) -> str:
    if datatype in INTEGERS:
        return str(int(number))
    return f"{Decimal(repr(number)):f}" if datatype == XSD.decimal else repr(float(number))


def _is_numeric(datatype: URIRef) -> bool:
    return datatype in INTEGERS or datatype in _BROKEN


def _said(datatypes: tuple[URIRef, ...]) -> str:
    if any(datatype in _BROKEN for datatype in datatypes):
        return "number"
    return " or ".join(local_name(str(datatype)) for datatype in datatypes if datatype) or "number"
