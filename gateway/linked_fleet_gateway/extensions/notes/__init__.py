"""Notes: what people write down about robots, their parts and faults for each other. See README.md."""
