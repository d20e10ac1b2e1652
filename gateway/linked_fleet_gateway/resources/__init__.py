"""Resources: the tree, and how each resource is described, versioned and filtered by rights. Pure.

``tree``: the only mapping from paths to resources; ``branches``: resources added by extensions; ``paths``: names in
paths. ``resource``: the result of resolving a path; ``affordance``: its methods other than reading.
``access_filter``: the part that a caller may see. ``describe``, ``properties``, ``invocation``,
``subscription_resource``, ``documents``: descriptions. ``versioning``: definition of change. ``renderings``: measured
values compiled, for GET and for messages. ``action_definition``, ``action_offer``, ``action_conditions``,
``shape_parameters``: kinds of actions, the things that offer them, and the parts of their shapes that depend on the
robot. ``action_body``, ``named_poses``: bodies as typed values in SI units. ``setting``, ``settable``,
``annotations``: values that clients may set. ``json_form``, ``plain_json``: JSON derived from shapes.
``binary_frames``: frames and their layouts. ``subscription``: the data of a subscription.
"""
