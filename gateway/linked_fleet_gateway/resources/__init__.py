"""Resources: the tree, and how each resource is described, versioned and filtered by rights. Pure.

``tree``: path → resource, and nowhere else; ``branches``: what extensions add to it; ``paths``: names in paths.
``resource``: what a path resolves to; ``affordance``: what can be done to it. ``access_filter``: what a caller may see.
``describe``, ``properties``, ``invocation``, ``lease``, ``subscription_resource``, ``documents``: descriptions.
``versioning``: what counts as change. ``template``, ``renderings``: measured values compiled, for GET and for messages.
``action_definition``, ``action_offer``, ``action_conditions``, ``shape_parameters``: kinds of actions, who offers them,
and what the robot at hand adds to their shapes. ``action_body``, ``named_poses``: bodies as typed values in SI units.
``setting``, ``settable``, ``annotations``, ``placement``: what clients may set. ``json_form``, ``plain_json``: JSON by
the form of a shape. ``binary_frames``: frames and their layouts. ``subscription``: what a subscription is.
"""
