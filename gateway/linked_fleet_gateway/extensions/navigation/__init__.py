"""Drives of bases to a goal: ways round what stands on the floor, and who gives way when robots meet."""
