"""What happened in the fleet, what happens and what is planned, by robot (README.md)."""
