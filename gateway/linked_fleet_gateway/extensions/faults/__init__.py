"""Faults: what is wrong with robots and with what they do, from the first sign until it is cleared."""
