"""Missions: actions made of actions (paper 5.4), which outlive the gateway that runs them. See README.md."""

from linked_fleet_gateway.extensions.missions.extension import MissionsExtension

__all__ = ["MissionsExtension"]
