"""Models: the URDF of a robot, and its meshes from the disk of its agent (desideratum D5)."""
