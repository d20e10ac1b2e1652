"""The purpose of each kind of page, for its `?`: a message, and where the documentation says more."""

from dataclasses import dataclass

from linked_fleet_gateway.extensions.pages.languages import message, translated
from linked_fleet_gateway.extensions.pages.views import added_views

DOCS = "https://w3id.org/linked-fleet/source/HEAD/"
"""The address of the documentation; deploy/w3id/.htaccess says where this leads."""


@dataclass(frozen=True)
class Help:
    """A sentence or more on a page. ``guide``: the address of a page of documentation."""

    text: str
    guide: str


_OWN = {
    "fleet": (
        message(
            "All robots of this fleet. Those with trouble come first. Open a robot to see it in 3D and to move it; the"
            " table shows many robots at once, and stops or marks those that you choose."
        ),
        "docs/MAP.md",
    ),
    "robot": (
        message(
            "One robot: what it does, where its joints stand, and how to move it. Take control before you move it, so"
            " that nobody else does. Stop at the top right halts it at once, with or without control."
        ),
        "docs/DRIVING.md",
    ),
    "joint": (
        message("One joint: its position between its limits, and actions that move it alone."),
        "docs/DRIVING.md",
    ),
    "link": (message("One rigid part of the robot, and what is measured at it."), "docs/DESCRIPTIONS.md"),
    "joint_state": (message("The latest position, speed and effort of all joints."), "docs/DESCRIPTIONS.md"),
    "property": (message("One value of the robot. If it is a setting, it can be changed here."), "docs/MAP.md"),
    "annotations": (
        message("What people and programs say of the robot besides its values, such as its serial number."),
        "docs/MAP.md",
    ),
    "action": (
        message(
            'One thing that can be done here. Fill in the fields that are marked by *. "Try without moving" says what'
            " would happen, and nothing moves."
        ),
        "docs/DRIVING.md",
    ),
    "invocation": (
        message("One order that was given: who gave it, how far it is, and how it ended."),
        "docs/DRIVING.md",
    ),
    "invocations": (message("What was done by this action, the latest first."), "docs/DRIVING.md"),
    "lease": (
        message("Who has control of the robot. Only they can move it; everybody with the right can stop it."),
        "docs/DRIVING.md",
    ),
    "subscriptions": (message("Who is told of changes, and by which way."), "docs/MAP.md"),
    "subscription": (message("One receiver of news, and whether news reach it."), "docs/MAP.md"),
    "vocabulary": (message("The words that this gateway uses in data, each with its meaning."), "shapes/README.md"),
    "document": (message("All that is known of one thing."), "docs/MAP.md"),
    "login": (message("Log in to see the fleet, or see which rights you have."), "docs/IDENTITIES.md"),
    "problem": (
        message("The request was refused, or failed. The sentence above says why, and what is right."),
        "docs/MAP.md",
    ),
}


def help_of(kind: str) -> Help | None:
    """Return the help of a kind of page in the language of the page; None for a view that has none."""
    own = _OWN.get(kind) or next(((each.help, each.guide) for each in added_views() if each.kind == kind), ("", ""))
    text, guide = own
    return Help(translated(text), guide if "://" in guide or not guide else DOCS + guide) if text else None
