"""Translates the body of one method or function for the compiler: numbers by index, calls by name, without objects.

Raises Untranslatable for code without a translation. Conditions that are known during the translation are resolved.
"""

from __future__ import annotations

import ast
import builtins
from collections import Counter
from types import FunctionType, MethodType, ModuleType
from typing import Any, Protocol

import numpy as np

Path = tuple[str, ...]
_MATH = {
    "acos", "asin", "atan", "atan2", "copysign", "cos", "cosh", "e", "exp", "expm1", "fabs", "floor", "fmod", "inf",
    "isfinite", "isnan", "log", "log1p", "nan", "phase", "pi", "sin", "sinh", "sqrt", "tan", "tanh", "tau",
}  # fmt: skip
_BUILTIN = {"abs", "bool", "complex", "enumerate", "float", "int", "len", "max", "min", "range", "reversed", "zip"}
_REFUSED = (
    ast.AsyncFunctionDef, ast.Await, ast.ClassDef, ast.Delete, ast.Dict, ast.DictComp, ast.FunctionDef, ast.Global,
    ast.Import, ast.ImportFrom, ast.JoinedStr, ast.Lambda, ast.Match, ast.Nonlocal, ast.Raise, ast.Set, ast.SetComp,
    ast.Starred, ast.Try, ast.With, ast.Yield, ast.YieldFrom,
)  # fmt: skip


class Untranslatable(Exception):
    """The code has no translation."""


class Whole(Protocol):
    """The translation of a controller, of which a body is one part."""

    names: dict[str, Any]

    def look(self, path: Path) -> Any:
        """The object at a path, on which the text then depends."""

    def place(self, path: Path, size: int) -> int:
        """The index of the first word of the number at a path."""

    def function(self, function: Any, owner: Path | None) -> str:
        """The name of a translated function, or of a method of the object at `owner`."""

    def object(self, path: Path) -> Any:
        """The object at a path."""


class Body(ast.NodeTransformer):
    """The text of one function: it reads attributes of its object as words and calls functions by name."""

    def __init__(self, whole: Whole, function: FunctionType, own: str, owner: Path, stores: Counter[str]) -> None:
        """`stores`: arguments and local names, and how often each gets a value."""
        if "_r" in stores or "_i" in stores:
            raise Untranslatable("a name that the text itself needs")
        self.whole, self.globals, self.stores, self.local = whole, function.__globals__, stores, set(stores)
        self.objects: dict[str, Path] = {own: owner} if own else {}
        self.values = function.__code__.co_varnames[3] if own and not owner and function.__name__ == "update" else ""
        """The name of the measurements."""
        self.bound: list[dict[str, ast.expr]] = []

    def statement(self, node: ast.stmt) -> list[ast.stmt]:
        """The translation of a statement."""
        made = self.visit(node)
        return [] if made is None else made if isinstance(made, list) else [made]

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Nodes without a special translation."""
        if isinstance(node, _REFUSED):
            raise Untranslatable(f"{type(node).__name__} (line {getattr(node, 'lineno', 0)})")
        return super().generic_visit(node)

    def path(self, node: ast.AST) -> Path | None:
        """The path of `self.a.b`, or of a local name for a part of it."""
        if isinstance(node, ast.Name):
            return self.objects.get(node.id)
        if isinstance(node, ast.Attribute):
            before = self.path(node.value)
            return None if before is None else (*before, node.attr)
        return None

    def value(self, path: Path) -> ast.expr:
        """An expression for the value at a path."""
        value = self.whole.look(path)
        if value is None or isinstance(value, str):
            return ast.Constant(value)
        if isinstance(value, tuple):
            return ast.Tuple([self.value((*path, str(i))) for i in range(len(value))], ast.Load())
        if isinstance(value, bool):
            return _parsed(f"(_i[{self.whole.place(path, 1)}] != 0)")
        if isinstance(value, int):
            return _parsed(f"_i[{self.whole.place(path, 1)}]")
        if isinstance(value, float):
            return _parsed(f"_r[{self.whole.place(path, 1)}]")
        if isinstance(value, complex):
            at = self.whole.place(path, 2)
            return _parsed(f"complex(_r[{at}], _r[{at + 1}])")
        raise Untranslatable(f"{'.'.join(path)} is a {type(value).__name__}")

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """A word of the object, or a name of a module."""
        if (path := self.path(node)) is not None:
            return self.value(path)
        module = self.globals.get(node.value.id) if isinstance(node.value, ast.Name) else None
        if isinstance(module, ModuleType) and isinstance(node.value, ast.Name) and node.value.id not in self.local:
            if module.__name__ not in ("math", "cmath") or node.attr not in _MATH:
                raise Untranslatable(f"{module.__name__}.{node.attr}")
            if node.attr == "fmod":  # the compiler knows it by another name
                self.whole.names["_numpy"] = np
                return _parsed("_numpy.fmod")
            self.whole.names[node.value.id] = module
            return node
        return self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """A local name, a constant, a class of records."""
        for bound in reversed(self.bound):
            if node.id in bound:
                return bound[node.id]
        if node.id in self.objects:
            raise Untranslatable(f"{node.id} is passed on")
        if node.id in self.local or isinstance(node.ctx, ast.Store):
            return node
        if node.id not in self.globals:
            if node.id in _BUILTIN and hasattr(builtins, node.id):
                return node
            raise Untranslatable(node.id)
        value = self.globals[node.id]
        record = isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")
        if not (record or _constant(value)):
            raise Untranslatable(f"{node.id} is a {type(value).__name__}")
        if self.whole.names.setdefault(node.id, value) is not value:
            raise Untranslatable(f"{node.id} has two meanings")
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """A call of a method or of a function of the module; a call that makes a tuple becomes its entries."""
        if isinstance(node.func, ast.Name) and node.func.id == "tuple" and len(node.args) == 1:
            if isinstance(node.args[0], ast.ListComp | ast.GeneratorExp):
                return self.visit(node.args[0])  # type: ignore[no-any-return]
            raise Untranslatable("tuple()")
        path, called, owner = self.path(node.func), None, None
        if path is not None:
            called = self.whole.look(path)
            if isinstance(called, MethodType):
                if called.__self__ is not self.whole.object(path[:-1]):
                    raise Untranslatable(f"{'.'.join(path)} is bound to something else")
                called, owner = called.__func__, path[:-1]
        elif isinstance(node.func, ast.Name) and node.func.id not in self.local:
            called = self.globals.get(node.func.id)
            called = called if isinstance(called, FunctionType) else None
        if called is None:
            return self.plain_call(node)
        if node.keywords:
            raise Untranslatable("a call with keywords")
        name = self.whole.function(called, owner)
        given = [ast.Name("_r", ast.Load()), ast.Name("_i", ast.Load()), *map(self.visit, node.args)]
        return ast.Call(ast.Name(name, ast.Load()), given, [])

    def plain_call(self, node: ast.Call) -> ast.AST:
        """A call that needs no translation; a record gets all its fields in order."""
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name == "len" and isinstance(node.args[0], ast.Name) and node.args[0].id == self.values:
            return ast.Constant(len(self.whole.look(("reads",))))
        made = self.generic_visit(node)
        assert isinstance(made, ast.Call)
        record = self.globals.get(name) if name not in self.local else None
        if made.keywords and isinstance(record, type):
            given = {**record._field_defaults, **dict(zip(record._fields, made.args))}  # type: ignore[attr-defined]
            given |= {word.arg: word.value for word in made.keywords}
            entries = [given[field] for field in record._fields]  # type: ignore[attr-defined]
            made.args = [one if isinstance(one, ast.expr) else ast.Constant(one) for one in entries]
            made.keywords = []
        return made

    def visit_ListComp(self, node: ast.ListComp | ast.GeneratorExp) -> ast.AST:
        """A comprehension as a tuple of its entries; the length of one of the iterated tuples must be known."""
        (over,) = node.generators if len(node.generators) == 1 else (None,)
        if over is None or over.ifs or over.is_async:
            raise Untranslatable("a comprehension with conditions")
        call = over.iter
        zipped = isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "zip"
        sources = [self.visit(one) for one in (call.args if zipped and isinstance(call, ast.Call) else [call])]
        lengths = {len(one.elts) for one in sources if isinstance(one, ast.Tuple)}
        if len(lengths) != 1:
            raise Untranslatable("a comprehension over what has no known length")
        targets = list(over.target.elts) if zipped and isinstance(over.target, ast.Tuple) else [over.target]
        if len(targets) != len(sources) or not all(isinstance(target, ast.Name) for target in targets):
            raise Untranslatable("a comprehension over nested tuples")
        entries = []
        for k in range(lengths.pop()):
            each = [
                one.elts[k] if isinstance(one, ast.Tuple) else ast.Subscript(one, ast.Constant(k), ast.Load())
                for one in sources
            ]
            self.bound.append(
                {target.id: value for target, value in zip(targets, each) if isinstance(target, ast.Name)}
            )
            entries.append(self.visit(_parsed(ast.unparse(node.elt))))
            self.bound.pop()
        return ast.Tuple(entries, ast.Load())

    def visit_GeneratorExp(self, node: ast.GeneratorExp) -> ast.AST:
        """A generator expression, translated as a list comprehension."""
        return self.visit_ListComp(node)

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        """An assignment; a local name for a part of the object represents that path afterwards."""
        target, value = node.targets[0], node.value
        if len(node.targets) == 1 and isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = list(zip(target.elts, value.elts, strict=True))
            left = [pair for pair in pairs if not self.part(*pair)]
            node.targets, node.value = (
                [ast.Tuple([t for t, _ in left], ast.Store())],
                ast.Tuple([v for _, v in left], ast.Load()),
            )
            if not left:
                return None
        elif len(node.targets) == 1 and self.part(target, value):
            return None
        stored = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        if stored & self.objects.keys():
            raise Untranslatable(f"{', '.join(stored)} is assigned again")
        return self.generic_visit(node)

    def part(self, target: ast.expr, value: ast.expr) -> bool:
        """Whether the assignment names a part of the object that is not a number."""
        path = self.path(value)
        if path is None or not isinstance(target, ast.Name):
            return False
        known = self.whole.look(path)
        if known is None or isinstance(known, str | tuple | bool | int | float | complex):
            return False
        if self.stores[target.id] > 1:
            raise Untranslatable(f"{target.id} has more than one value")
        self.objects[target.id] = path
        return True

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        """An annotated assignment, without its annotation."""
        if node.value is None:
            return None
        return self.visit(ast.copy_location(ast.Assign([node.target], node.value), node))  # type: ignore[no-any-return]

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """An expression statement; docstrings are dropped."""
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """A binary operation; powers have no translation."""
        if isinstance(node.op, ast.Pow | ast.MatMult):
            raise Untranslatable("a power")
        return self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        """An augmented assignment; powers have no translation."""
        if isinstance(node.op, ast.Pow | ast.MatMult):
            raise Untranslatable("a power")
        return self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """A comparison; one that is known during the translation, such as `self.observer is None`, is resolved."""
        left, right = node.left, node.comparators[0]
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.Is | ast.IsNot):
            path = self.path(left)
            if path is None or not (isinstance(right, ast.Constant) and right.value is None):
                raise Untranslatable("an identity")
            return ast.Constant((self.whole.look(path) is None) == isinstance(node.ops[0], ast.Is))
        made = self.generic_visit(node)
        assert isinstance(made, ast.Compare)
        if all(isinstance(one, ast.Constant) for one in (made.left, *made.comparators)):
            return ast.Constant(bool(eval(ast.unparse(made))))  # of constants
        return made

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """A unary operation; `not` of a known condition is resolved."""
        made = self.generic_visit(node)
        if isinstance(made, ast.UnaryOp) and isinstance(made.op, ast.Not) and isinstance(made.operand, ast.Constant):
            return ast.Constant(not made.operand.value)
        return made

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        """A condition; of a known one only the branch that is taken."""
        test = self.visit(node.test)
        if isinstance(test, ast.Constant):
            return [made for one in (node.body if test.value else node.orelse) for made in self.statement(one)]
        body, other = ([made for one in part for made in self.statement(one)] for part in (node.body, node.orelse))
        return ast.If(test, body or [ast.Pass()], other)

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        """A conditional expression; of a known condition only the value that is taken."""
        test = self.visit(node.test)
        if isinstance(test, ast.Constant):
            return self.visit(node.body if test.value else node.orelse)  # type: ignore[no-any-return]
        return ast.IfExp(test, self.visit(node.body), self.visit(node.orelse))


def _constant(value: Any) -> bool:
    return isinstance(value, bool | int | float | complex) or (isinstance(value, tuple) and all(map(_constant, value)))


def _parsed(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body
