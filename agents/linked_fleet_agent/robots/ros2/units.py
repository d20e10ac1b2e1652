"""Units and terms of fields of ROS 2 messages (REP 103, and the comments of the messages' own files).

A key names a type, a field of it, or a field of a field: ``geometry_msgs/msg/Twist.linear`` gives all numbers in the
linear velocity their unit. What a type says of its parts comes before what the parts say of themselves.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from linked_fleet_agent.wire.kinds import LF


class Meaning(NamedTuple):
    """The QUDT unit of a number by its local name, and the IRI of the term that a value means; both may be empty."""

    unit: str = ""
    term: str = ""


Meanings = Mapping[str, Meaning]
_UNITS = {
    "M": "geometry_msgs/msg/Point geometry_msgs/msg/Point32 geometry_msgs/msg/Transform.translation "
    "geometry_msgs/msg/Inertia.com geometry_msgs/msg/Pose2D.x geometry_msgs/msg/Pose2D.y "
    "nav_msgs/msg/MapMetaData.resolution "
    "sensor_msgs/msg/Range.min_range sensor_msgs/msg/Range.max_range sensor_msgs/msg/Range.range "
    "sensor_msgs/msg/LaserScan.range_min sensor_msgs/msg/LaserScan.range_max sensor_msgs/msg/LaserScan.ranges "
    "sensor_msgs/msg/NavSatFix.altitude control_msgs/msg/GripperCommand.position "
    "control_msgs/action/GripperCommand_Result.position control_msgs/action/GripperCommand_Feedback.position "
    "nav2_msgs/action/NavigateToPose_Feedback.distance_remaining "
    "nav2_msgs/action/NavigateToPose_Feedback.position_tracking_error",
    "RAD": "geometry_msgs/msg/Pose2D.theta sensor_msgs/msg/Range.field_of_view sensor_msgs/msg/LaserScan.angle_min "
    "sensor_msgs/msg/LaserScan.angle_max sensor_msgs/msg/LaserScan.angle_increment "
    "nav2_msgs/action/NavigateToPose_Feedback.heading_tracking_error",
    "M-PER-SEC": "geometry_msgs/msg/Twist.linear",
    "RAD-PER-SEC": "geometry_msgs/msg/Twist.angular sensor_msgs/msg/Imu.angular_velocity",
    "M-PER-SEC2": "geometry_msgs/msg/Accel.linear sensor_msgs/msg/Imu.linear_acceleration",
    "RAD-PER-SEC2": "geometry_msgs/msg/Accel.angular",
    "N": "geometry_msgs/msg/Wrench.force control_msgs/msg/GripperCommand.max_effort "
    "control_msgs/action/GripperCommand_Result.effort control_msgs/action/GripperCommand_Feedback.effort",
    "N-M": "geometry_msgs/msg/Wrench.torque",
    "KiloGM": "geometry_msgs/msg/Inertia.m",
    "SEC": "builtin_interfaces/msg/Time builtin_interfaces/msg/Duration sensor_msgs/msg/LaserScan.time_increment "
    "sensor_msgs/msg/LaserScan.scan_time control_msgs/msg/JointJog.duration "
    "nav2_msgs/action/DockRobot_Goal.max_staging_time nav2_msgs/action/UndockRobot_Goal.max_undocking_time",
    "DEG": "sensor_msgs/msg/NavSatFix.latitude sensor_msgs/msg/NavSatFix.longitude",
    "DEG_C": "sensor_msgs/msg/Temperature.temperature sensor_msgs/msg/BatteryState.temperature "
    "sensor_msgs/msg/BatteryState.cell_temperature",
    "V": "sensor_msgs/msg/BatteryState.voltage sensor_msgs/msg/BatteryState.cell_voltage",
    "A": "sensor_msgs/msg/BatteryState.current",
    "A-HR": "sensor_msgs/msg/BatteryState.charge sensor_msgs/msg/BatteryState.capacity "
    "sensor_msgs/msg/BatteryState.design_capacity",
    "PA": "sensor_msgs/msg/FluidPressure.fluid_pressure",
    "T": "sensor_msgs/msg/MagneticField.magnetic_field",
    "LUX": "sensor_msgs/msg/Illuminance.illuminance",
}
_TERMS = {
    "sensor_msgs/msg/BatteryState.voltage": LF + "voltage",
    "sensor_msgs/msg/BatteryState.current": LF + "electricCurrent",
}
MEANINGS: Meanings = {
    key: Meaning(unit, _TERMS.get(key, "")) for unit, keys in _UNITS.items() for key in keys.split()
}  # fmt: skip
"""The units that are known without configuration."""


def meaning_of(places: Sequence[tuple[str, str]], *tables: Meanings) -> Meaning:
    """Return the meaning of a value; the first table that has one decides.

    ``places`` are the types in which it is, from the outermost to its own, each with the path from there, such as
    ``("geometry_msgs/msg/Twist", "linear.x")``.
    """
    for table in tables:
        for type_, path in places:
            parts = path.split(".") if path else []
            for length in range(len(parts), -1, -1):
                found = table.get(".".join((type_, *parts[:length])))
                if found is not None:
                    return found
    return Meaning()
