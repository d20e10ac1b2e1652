"""The sentences in which motions are refused because of what the check found."""

from collections.abc import Mapping

from linked_fleet_gateway.api import link_path
from linked_fleet_gateway.extensions.world.collisions import Collides, UncheckedLinks
from linked_fleet_gateway.extensions.world.descriptions import object_path
from linked_fleet_gateway.extensions.world.floor_map import ID, NO_MAPS, Maps
from linked_fleet_gateway.extensions.world.map_resources import MAP
from linked_fleet_gateway.extensions.world.messages import CollisionFound, UncheckedNear
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.faces import unchecked_links as links_of
from linked_fleet_state.model import RobotModel
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import in_words


class Refusals:
    """Creates refusals, which name robots and objects by their titles."""

    def __init__(self, robots: Mapping[str, Robot], objects: Mapping[str, SceneObject], maps: Maps = NO_MAPS) -> None:
        self._robots, self._objects, self._maps = robots, objects, maps

    @property
    def _map(self) -> str:
        """The name of the map of the floor."""
        found = self._maps.get(ID)
        return "the map of the floor" if found is None else f"{found.title} (map of the floor)"

    def unchecked_links(self, robot: Robot, near: UncheckedNear) -> UncheckedLinks:
        """Return the refusal of a motion whose robot, or whose neighbour, has links that the check does not cover."""
        thing = self._objects.get(near.name) if near.kind == "object" else None
        met = near.name or "another robot" if thing is None else thing.title
        if near.kind == "map":
            met = f"an occupied place of {self._map}"
        if near.own:
            links, whose, reason = links_of(robot), robot.name, "parts of the robot that no check covers"
        else:
            other = self._robots.get(near.name)
            links, whose, met = () if other is None else links_of(other), met, robot.name
            reason = "parts of another robot that no check covers"
        named = f": {in_words(link for _, link in links)}" if links else ""
        advice = f"Mend the shapes, stand further apart, or PUT lf:acceptsUnchecked true in the placement of {whose}"
        return UncheckedLinks(
            f"The check does not cover parts of {whose} that may meet {met}{named}. {advice}.",
            unchecked=links,
            reason=f"{reason} might collide",
        )

    def collision(self, robot: Robot, model: RobotModel, met: CollisionFound) -> Collides:
        """Return the collision of a robot that had this model when it was checked."""
        link, other = link_path(robot.name, model, met.link), None
        mover, of_robot = met.link, f"{met.link} of {robot.name}"
        if met.held:
            mover, of_robot, link = self._held(met.held, met.link, robot.name, link)
        if met.kind == "self":
            what, other = f"its own {met.other}", link_path(robot.name, model, met.other)
            kind = what
            if met.other_held:
                kind, what, other = self._held(met.other_held, met.other, robot.name, other)
        elif met.kind == "robot":
            there, kind = self._robots.get(met.name), "another robot"
            what = kind
            if there is not None and there.model is not None:
                what, other = f"{met.other} of {met.name}", link_path(met.name, there.model, met.other)
                if met.other_held:
                    _, what, other = self._held(met.other_held, met.other, met.name, other)
        elif met.kind == "map":
            kind, other = "an occupied place of the map of the floor", MAP
            what = self._map
        else:
            thing = self._objects.get(met.name)
            kind = "a keep-out zone" if thing is not None and thing.kind == "zone" else "an obstacle"
            what = kind if thing is None else f"{thing.title} ({kind.partition(' ')[2]})"
            other = object_path(met.name)
        said = f"an occupied place of {what}{_at(met)}" if met.kind == "map" else what
        after = f"after {100 * met.share:.0f} % of the way"
        return Collides(
            f"{of_robot}{',' if met.held else ''} would meet {said}{',' if met.other_held else ''} {after}.",
            things=[link, *([] if other is None else [other])],
            names=[of_robot, *([] if other is None else [what])],
            share=met.share,
            point=None if other is None else met.point,  # a robot that the caller may not see has no place either
            reason=f"{mover} would meet {kind} {after}",
        )

    def _held(self, id: str, link: str, robot: str, path: str) -> tuple[str, str, str]:
        """Return what a link holds: without its title, with it and the robot, and its path, or that of the link."""
        thing = self._objects.get(id)
        if thing is None:
            return f"what {link} holds", f"what {link} of {robot} holds", path
        return f"what {link} holds", f"{thing.title}, which {link} of {robot} holds", object_path(id)


def _at(met: CollisionFound) -> str:
    """Return the place on the floor in words; empty if it is unknown."""
    return "" if met.point is None else f" at x {met.point[0]:.2f} m, y {met.point[1]:.2f} m"
