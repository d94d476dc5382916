"""The signatures of `rig` on the site: types that it imports for type checkers only, and what it says of parameters."""

import ast
import inspect
import re
from typing import get_type_hints

import rig
from rig.cli.stated import stated


def make_known() -> None:
    """Carry out the imports under `if TYPE_CHECKING:` of the package `rig` in its namespace, and list its parameters.

    A signature then has the types alone; what it states of a parameter stands in a list below the docstring.
    """
    for node in ast.parse(inspect.getsource(rig)).body:
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            code = ast.Module(body=node.body, type_ignores=[])
            exec(compile(code, rig.__file__, "exec"), vars(rig))
    for function in filter(inspect.isfunction, map(vars(rig).get, rig.__all__)):
        texts = {name: re.sub(r"([*|_`\\])", r"\\\1", one.option.help) for name, one in stated(function).items()}
        fields = [f":param {name}: {text}" for name, text in texts.items()]
        function.__doc__ = "\n".join([inspect.getdoc(function) or "", "", *fields])
        function.__annotations__ = get_type_hints(function)
