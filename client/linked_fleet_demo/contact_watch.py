"""Decides which contacts are collisions of robots that move. Pure."""

from collections.abc import Collection, Iterable

from linked_fleet_agent.robots.contact_model import TOUCH_M, Contact

BRAKING_S = 2.0
"""A robot that was stopped is not stopped again before this time."""


class ContactWatch:
    """Remembers what touches while robots stand, such as what they are put on or what is put against them."""

    def __init__(self) -> None:
        self._touching: dict[tuple[str, str], float] = {}
        self._stopped_s: dict[str, float] = {}

    def collisions(self, contacts: Iterable[Contact], moving: Collection[str], now_s: float) -> list[Contact]:
        """Return the contacts into which a robot has moved: new ones, and known ones that have become deeper."""
        present = {(each.robot, each.other): each for each in contacts}
        self._touching = {pair: depth for pair, depth in self._touching.items() if pair in present}
        found: dict[str, Contact] = {}
        for pair, each in present.items():
            known_m = self._touching.get(pair, 0.0)
            standing = each.robot not in moving or now_s - self._stopped_s.get(each.robot, -BRAKING_S) < BRAKING_S
            if standing:
                self._touching[pair] = max(known_m, each.depth_m)
            elif each.depth_m > known_m + (TOUCH_M if known_m else 0.0):
                self._touching[pair] = each.depth_m
                found.setdefault(each.robot, each)
        self._stopped_s |= dict.fromkeys(found, now_s)
        return list(found.values())

    def not_stopped(self, contact: Contact) -> None:
        """Have a contact found again, because its robot could not be stopped."""
        self._stopped_s.pop(contact.robot, None)
        self._touching.pop((contact.robot, contact.other), None)
