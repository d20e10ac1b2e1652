"""People: who is here, who has control of which robot, and how control goes from one to another. See README.md."""
