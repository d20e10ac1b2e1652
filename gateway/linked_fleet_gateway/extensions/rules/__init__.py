"""Rules: invoke an action when a pattern over the live fleet starts to hold (paper, desideratum D6; README.md).

change → condition (a query) → rows that started to hold (``edges``) → firings, claimed in Redis by the one gateway that
serves rules (``service``, ``engine``) → actions (``template``, ``rule_invocation``). ``causes``: detection of rules
that trigger themselves. ``rule``: rules and firings as values; ``store``, ``redis_scripts``: Redis. ``http``,
``request``, ``description``, ``page``: rules as resources. ``extension`` mounts them.
"""
