"""Translates the `update` of a controller to plain functions of numbers, for a compiler without objects.

Attributes of the controller become words of one array, integers and floating-point numbers; `words` reads them whenever
they may have changed. Properties on which the text depends, such as the length of a tuple, a path that is None or the
method of a name, are `facts`: the text is valid for every controller with equal facts. Called methods and functions are
translated too. `Untranslatable` states what has no translation; the controller then runs in Python, only slower.

Operations that a compiler rounds differently are not translated: powers, `sum` (compensated in newer Python), `hypot`.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from types import FunctionType, MethodType
from typing import Any, NamedTuple

from rig.controllers.runtime.body import Body, Path, Untranslatable


class Translated(NamedTuple):
    """Translated functions: name -> text, called ones before their callers; the last is `update`.

    Each takes `_r` and `_i`, the words as floating-point numbers and as integers, before its own arguments. `names`:
    other objects in the texts. `paths`: origins of the words, in order. `facts`: properties that the texts depend on.
    """

    functions: dict[str, str]
    names: dict[str, Any]
    paths: tuple[Path, ...]
    facts: tuple[tuple[Path, Any], ...]


def found(root: Any, path: Path) -> Any:
    """The object at a path."""
    for name in path:
        root = root[int(name)] if name.isdigit() else getattr(root, name)
    return root


def fact(value: Any) -> Any:
    """The property of a value on which a text may depend."""
    if isinstance(value, MethodType):
        return value.__func__
    if isinstance(value, tuple):
        return tuple, len(value)
    return value if value is None or isinstance(value, str | FunctionType) else type(value)


def words(root: Any, paths: Sequence[Path]) -> list[float | int]:
    """The present words of a controller."""
    values: list[float | int] = []
    for path in paths:
        value = found(root, path)
        values += [value.real, value.imag] if isinstance(value, complex) else [value]
    return values


def translate(controller: Any) -> Translated:
    """Translate the `update` of a controller. Raises Untranslatable."""
    return _Translation(controller).whole()


class _Translation:
    def __init__(self, controller: Any) -> None:
        self.root = controller
        self.functions: dict[str, str] = {}
        self.names: dict[str, Any] = {}
        self.facts: dict[Path, Any] = {}
        self._places: dict[Path, int] = {}
        self._count = 0
        self._known: dict[tuple[Any, Path], str] = {}

    def whole(self) -> Translated:
        """The whole translation."""
        self.function(self.look(("update",)).__func__, ())
        return Translated(self.functions, self.names, tuple(self._places), tuple(self.facts.items()))

    def look(self, path: Path) -> Any:
        """The object at a path, on which the text then depends."""
        try:
            value = found(self.root, path)
        except Exception as error:
            raise Untranslatable(f"{'.'.join(path)}: {error}") from error
        self.facts[path] = fact(value)
        return value

    def object(self, path: Path) -> Any:
        """The object at a path."""
        return found(self.root, path)

    def place(self, path: Path, size: int) -> int:
        """The index of the first word of the number at a path."""
        if path not in self._places:
            self._places[path] = self._count
            self._count += size
        return self._places[path]

    def function(self, function: Callable[..., Any], owner: Path | None) -> str:
        """The name of a translated function, or of a method of the object at `owner`."""
        key = function, () if owner is None else owner
        if key in self._known:
            return self._known[key]
        if not isinstance(function, FunctionType) or function.__closure__:
            raise Untranslatable(f"{function} is not a plain function")
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        except (OSError, TypeError, SyntaxError) as error:
            raise Untranslatable(f"{function.__qualname__}: {error}") from error
        if not isinstance(tree, ast.FunctionDef) or tree.decorator_list:
            raise Untranslatable(f"{function.__qualname__} is decorated")
        name = self._known[key] = f"{function.__name__.strip('_')}_{len(self._known)}"
        taken = tree.args
        if taken.vararg or taken.kwarg or taken.kwonlyargs or taken.defaults or taken.posonlyargs:
            raise Untranslatable(f"{function.__qualname__} takes more than plain arguments")
        arguments = [argument.arg for argument in taken.args]
        own = "" if owner is None else arguments.pop(0)
        body = Body(self, function, own, owner or (), Counter([*arguments, *_assigned(tree)]))
        lines = [line for statement in tree.body for line in body.statement(statement)]
        module = ast.Module([*lines, ast.Return(ast.Constant(None))] if not lines else lines, [])
        text = ast.unparse(ast.fix_missing_locations(module))
        self.functions[name] = f"def {name}({', '.join(['_r', '_i', *arguments])}):\n{textwrap.indent(text, '    ')}\n"
        return name


def _assigned(tree: ast.AST) -> list[str]:
    return [node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
