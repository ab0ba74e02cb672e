"""A robot from what others say of it: parameters of Nav2, a URDF, a bag.

findings: what a place says of a field, and what several come to. nav2, parameters, controllers: parameter files. urdf,
urdf_body, urdf_shapes, outline: URDF, its links, and the footprint of its shapes. recording: bags. write: the robot
file, with a source beside each number.
"""

from adrl.descriptions.findings import Finding, Reading, Settled, Standing, given_fields, settle
from adrl.descriptions.nav2 import read_nav2
from adrl.descriptions.recording import read_recorded_robot
from adrl.descriptions.urdf import read_urdf
from adrl.descriptions.write import drive_command, robot_of, robot_text

__all__ = [
    "Finding",
    "Reading",
    "Settled",
    "Standing",
    "drive_command",
    "given_fields",
    "read_nav2",
    "read_recorded_robot",
    "read_urdf",
    "robot_of",
    "robot_text",
    "settle",
]
