"""What the launch files have in common: a node of ADRL, and the launch arguments that it takes."""

import shutil
from collections.abc import Mapping, Sequence

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.descriptions import ParameterFile

COMMON = {
    "params_file": ("", "YAML file of the node's parameters; arguments that are given come before it"),
    "use_sim_time": ("", "true: the time is that of topic clock"),
    "namespace": ("", "of the node; one that the including launch file has pushed comes before it"),
    "log_level": ("info", "debug, info, warn or error"),
    "executable": ("adrl", "the command that pip installed, with its path if it is not on the terminal's"),
}
"""Argument of each launch file -> its default, and what it is."""


def launch_node(
    kind: str, *, name: str, settings: Sequence[str], topics: Mapping[str, str]
) -> LaunchDescription:
    """adrl ros2 KIND as the node of that name.

    settings: options of the command that are arguments of the launch file. What is left out is as the file of
    parameters says, else the command. topics: those that an argument renames, with the default.
    """
    of_command = f"see adrl ros2 {kind} --help"
    arguments = dict.fromkeys(settings, ("", of_command))
    arguments |= {topic: (default, "name of this topic") for topic, default in topics.items()}

    def start(context: LaunchContext) -> list[Node]:
        def told(argument: str) -> str:
            return LaunchConfiguration(argument).perform(context)

        executable = told("executable")
        if shutil.which(executable) is None:
            raise RuntimeError(
                f"there is no command {executable!r}: pip install ADRL first, or give executable:=/path/to/adrl"
            )
        file = [ParameterFile(told("params_file"), allow_substs=True)] if told("params_file") else []
        given = {
            setting: LaunchConfiguration(setting) for setting in ("use_sim_time", *settings) if told(setting)
        }
        # Never without: launch would write the arguments for nodes of any name, and the file's section would count.
        pushed = context.launch_configurations.get("ros_namespace")
        namespace = "" if pushed else f"/{told('namespace').strip('/')}"
        node = Node(
            executable=executable,
            arguments=["ros2", kind],
            ros_arguments=["--log-level", told("log_level")],
            name=name,
            namespace=namespace,
            parameters=[*file, given],
            # As Nav2 does: in a namespace the robot has transforms of its own.
            remappings=[
                ("/tf", "tf"),
                ("/tf_static", "tf_static"),
                *((topic, told(topic)) for topic in topics),
            ],
            output="screen",
        )
        return [node]

    declared = [
        DeclareLaunchArgument(argument, default_value=default, description=description)
        for argument, (default, description) in (arguments | COMMON).items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])
