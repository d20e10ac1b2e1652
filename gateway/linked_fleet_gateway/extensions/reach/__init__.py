"""Reach: inverse kinematics on Pinocchio, as the action ``reach`` and as the function ``lf:canReach`` of queries."""
