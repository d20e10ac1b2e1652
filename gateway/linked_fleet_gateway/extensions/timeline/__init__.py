"""The timeline: past, present and planned activities of the fleet, by robot (README.md)."""
