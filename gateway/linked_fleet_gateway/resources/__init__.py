"""Resources: the tree, and how each resource is described, versioned and filtered by rights. Pure.

``tree``, ``action_tree``: the only mapping from paths to resources; ``branches``: resources added by extensions;
``paths``: names in paths. ``resource``: the result of resolving a path; ``affordance``: its methods other than reading.
``access_filter``: the part that a caller may see. ``things``, ``describe``, ``property``, ``properties``,
``joint_kinds``, ``invocation``, ``subscription_resource``, ``documents``: descriptions. ``versioning``: definition of
change. ``description``: how they are described; ``templates``: documents into which values are put anew.
``action_offer``, ``shape_parameters``, ``joint_limits``: kinds of actions, the things that offer them, and the parts of
their shapes that depend on the robot. ``body_values``: bodies as typed values in SI units. ``settable``,
``annotations``: values that clients may set. ``json_form``, ``plain_json``: JSON derived from shapes.
``binary_frames``: frames and their layouts. ``subscription``, ``subscription_change``: the data of a
subscription, and its changes. ``relative_poses``: poses of things relative to each other. ``html``: the interface of
the extension that renders pages.
"""
