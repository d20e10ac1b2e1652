"""Read the depths of a camera by the terms of their layout: depth.py URL."""

import sys

import httpx
import numpy
import rdflib

LF = rdflib.Namespace("https://w3id.org/linked-fleet#")
frame = httpx.get(sys.argv[1], headers={"accept": "application/octet-stream"}, timeout=30)
layout = rdflib.Graph().parse(frame.links["describedby"]["url"])
kinds = {"char2": "S2", "uint16": "<u2", "uint64": "<u8", "int64": "<i8", "float32": "<f4", "float64": "<f8"}


def read(name: str) -> numpy.ndarray:
    node = layout.value(None, LF.fieldName, rdflib.Literal(name))
    kind, offset, count = (layout.value(node, each).value for each in (LF.fieldType, LF.byteOffset, LF.valueCount))
    return numpy.frombuffer(frame.content, kinds[kind], count, offset)


depth = read("depth").reshape(read("rows")[0], read("columns")[0])
print(len(frame.content), "bytes, frame", read("sequence")[0])
print("upper edge", depth[0, 160], "middle", depth[120, 160], "lower edge", depth[239, 160], "m")
print("nothing in range:", numpy.isnan(depth).sum(), "of", depth.size)
