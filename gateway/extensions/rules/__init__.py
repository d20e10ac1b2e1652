"""Declarative coordination (paper, desideratum D6): when a pattern over the live fleet starts to hold, an action."""
