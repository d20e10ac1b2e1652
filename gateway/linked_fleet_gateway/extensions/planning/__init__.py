"""Planning: paths of joints round what is in the way, and along straight lines, by a process of its own."""
