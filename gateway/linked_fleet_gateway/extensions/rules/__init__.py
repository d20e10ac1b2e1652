"""Rules: invoke an action when a pattern over the live fleet starts to hold (paper, desideratum D6; README.md).

change → condition (a query) → rows that started to hold (``edges``) → firings, claimed in Redis by the one gateway that
serves rules (``service``, ``engine``) → actions (``invoking``). ``causes``, ``loops``: detection of rules that trigger
themselves.
"""
