"""``--controller module:function``: the user's own control law."""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import click

from zwidth.files.protection import reading
from zwidth.sim.controller import Step


class ControlLaw(click.ParamType[Step]):
    """A function ``step(k, t, y, v, p, m)``, given as module:function of the current folder."""

    name = "MODULE:FUNCTION"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Step:
        """Import the function, or fail with what is wrong."""
        module_name, colon, function = str(value).partition(":")
        if not (module_name and colon and function):
            self.fail(f"{value} is not allowed; give module:function, such as my_wall:step.")
        folder = str(Path.cwd())
        sys.path.insert(0, folder)
        try:
            module = import_module(module_name)
        except Exception as error:  # any error of the user's own code during import
            self.fail(f"module {module_name} cannot be imported: {type(error).__name__}: {error}.")
        finally:
            sys.path.remove(folder)
        if module.__file__ is not None:
            reading(Path(module.__file__))
        found = getattr(module, function, None)
        if not callable(found):
            self.fail(f"module {module_name} has no function {function}.")
        return cast("Step", found)


controller_option = click.option(
    "--controller",
    type=ControlLaw(),
    help="Your own control law, for a scenario with kind = 'user'.",
)
