"""Print the numbers of a joint state or a measured property by binary frames: frames.py URL [how many frames]."""

import re
import struct
import sys
from itertools import islice

from rdflib import Graph, Namespace, URIRef
from websockets.sync.client import connect

LF = Namespace("https://w3id.org/linked-fleet#")
QUDT = Namespace("http://qudt.org/schema/qudt/")
CODES = {"char2": "2s", "uint16": "H", "uint32": "I", "uint64": "Q", "int64": "q", "float64": "d"}

url, frames = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None
accept = {"Accept": "application/octet-stream"}
with connect("ws" + url.removeprefix("http"), additional_headers=accept) as socket:
    links = re.findall(r'<([^>]*)>; *rel="([^"]*)"', socket.response.headers["Link"])
    layout = URIRef(next(target for target, relation in links if relation == "describedby"))
    graph = Graph().parse(layout)
    numbers = {
        int(graph.value(field, LF.byteOffset)): (
            "<" + CODES[str(graph.value(field, LF.fieldType))],
            graph.value(field, LF.fieldName),
            graph.value(field, QUDT.unit),
            graph.value(field, LF.ofProperty),
        )
        for field in graph.objects(layout, LF.field)
    }
    for frame in islice(socket, frames):
        for offset, (code, name, unit, of) in sorted(numbers.items()):
            print(name, struct.unpack_from(code, frame, offset)[0], unit, of, flush=True)
