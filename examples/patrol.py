"""A patrol of a mobile robot: it drives round and looks, and its pictures go into a recording that Foxglove opens.

Usage: python patrol.py http://127.0.0.1:8000/ [patrol.mcap [rounds]]

The mission drives and waits. Whoever watches its run takes the pictures, while a step named ``look`` lasts.
"""

import base64
import json
import sys
import time
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from linked_fleet_client.fleet import Fleet

METRE, DEGREE = "http://qudt.org/vocab/unit/M", "http://qudt.org/vocab/unit/DEG"
PLACES = {"the wall": (0.8, -3.2, 0.0), "the corner": (0.8, -2.4, 90.0), "home": (0.0, -2.4, 0.0)}
LOOK_S = 3
SCHEMA = {
    "type": "object",
    "properties": {
        "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        "frame_id": {"type": "string"},
        "data": {"type": "string", "contentEncoding": "base64"},
        "format": {"type": "string"},
    },
}


def steps(fleet: Fleet) -> list[dict[str, Any]]:
    drive, found = str(fleet["tiago"].actions["driveTo"].iri), list[dict[str, Any]]()
    for place, (x, y, heading) in PLACES.items():
        body = {"position": {"x": x, "y": y, "unit": METRE}, "heading": {"value": heading, "unit": DEGREE}}
        found.append({"type": "invoke", "action": drive, "body": body, "title": f"drive to {place}"})
        found.append({"type": "wait", "seconds": LOOK_S, "title": f"look from {place}"})
    return found


def picture(fleet: Fleet) -> dict[str, Any]:
    """Return a picture as a message of Foxglove."""
    camera = fleet["tiago"]["cameras"].parts["head"]
    jpeg = fleet.web.send("GET", str(camera.iri), None, {"accept": "image/jpeg"}).body
    now_ns = time.time_ns()
    stamp = {"sec": now_ns // 10**9, "nsec": now_ns % 10**9}
    return {"timestamp": stamp, "frame_id": "head", "data": base64.b64encode(jpeg).decode(), "format": "jpeg"}


def main(url: str, path: str = "patrol.mcap", rounds: str = "1") -> int:
    with Fleet(url) as fleet, Path(path).open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("foxglove.CompressedImage", "jsonschema", json.dumps(SCHEMA).encode())
        channel = writer.register_channel("/tiago/head", "json", schema)
        step = {"type": "repeat", "times": int(rounds), "step": {"type": "sequence", "steps": steps(fleet)}}
        run = fleet.missions.write({"title": "Patrol of TIAGo", "step": step}).run()
        taken = set[str]()
        for state in run.watch():
            for looking in state.in_state("waiting"):
                if looking.path not in taken:
                    taken.add(looking.path)
                    message, now_ns = json.dumps(picture(fleet)).encode(), time.time_ns()
                    writer.add_message(channel, now_ns, message, now_ns)
                    print(f"{looking.title}: picture {len(taken)}", flush=True)
        writer.finish()
        print(f"{run.wait()}: {len(taken)} pictures in {path}")
        return 0 if run.state == "succeeded" else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
