"""`ros2 bag diagnose`, for those who have ROS 2: an entry point of the group ros2bag.verb.

ros2cli creates one object of any class with these two methods; its docstring is the help
(https://github.com/ros2/rosbag2, ros2bag/verb/__init__.py). Nothing of ROS is imported.
"""

from argparse import REMAINDER, ArgumentParser, Namespace


class DiagnoseVerb:
    """Say why a bag differs from the simulation of a device (zwidth)."""

    NAME = None
    EXTENSION_POINT_VERSION = "0.1"

    def add_arguments(self, parser: ArgumentParser, cli_name: str) -> None:
        """Add the arguments of the verb; cli_name: of the program, not needed."""
        del cli_name
        parser.add_argument("bag_path", help="bag to diagnose")
        parser.add_argument(
            "options", nargs=REMAINDER, metavar="...",
            help="more bags, then the options that 'zwidth diagnose --help' lists",
        )  # fmt: skip

    def main(self, *, args: Namespace) -> int:
        """Diagnose; returns the exit status of `zwidth diagnose`."""
        from zwidth.cli import run  # `ros2 bag --help` creates the object, but does not need this

        return run(["diagnose", args.bag_path, *args.options])
