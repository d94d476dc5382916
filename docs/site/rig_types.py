"""The names of types that `rig` imports for type checkers only, made known so that signatures show and link them."""

import ast
import inspect

import rig


def make_known() -> None:
    """Carry out the imports under `if TYPE_CHECKING:` of the package `rig` in its namespace."""
    for node in ast.parse(inspect.getsource(rig)).body:
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            code = ast.Module(body=node.body, type_ignores=[])
            exec(compile(code, rig.__file__, "exec"), vars(rig))
