"""A controller with compiled `update`: the same answers as in Python, to the last bit.

The `update` of a controller is translated to plain functions of numbers, for a compiler without objects. Attributes of
the controller become words of one array, integers and floating-point numbers; `words` reads them whenever they may have
changed. Properties on which the text depends, such as the length of a tuple, a path that is None or the method of a
name, are `facts`: the text is valid for every controller with equal facts, and conditions that follow from them are
resolved. Called methods and functions are translated too. `Untranslatable` states what has no translation; the
controller then runs in Python, only slower.

The translation is compiled without fused or reordered operations, so it rounds as Python does. Operations that a
compiler rounds differently are not translated: powers, `sum` (compensated in newer Python), `hypot`. If Python would
raise an exception, or a value is not finite, the compiled code declines and changes nothing; the caller then calls the
controller itself. Before the compiled code is used, it has to reproduce answers of the controller.
"""

from __future__ import annotations

import ast
import builtins
import ctypes
import inspect
import math
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import count
from types import FunctionType, MethodType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]
from numba import typeof as _typeof

from rig.compiled.kernel import announce_compiling, as_python, called_by_address
from rig.controllers.blocks.base import Controller, State, Values, gets_every_sample

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


class Body(ast.NodeTransformer):
    """The text of one function: it reads attributes of its object as words and calls functions by name."""

    def __init__(
        self, whole: _Translation, function: FunctionType, own: str, owner: Path, stores: Counter[str]
    ) -> None:
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
                if called.__self__ is not at_path(self.whole.root, path[:-1]):
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
            made.args = [entry if isinstance(entry, ast.expr) else ast.Constant(entry) for entry in entries]
            made.keywords = []
        return made

    def visit_ListComp(self, node: ast.ListComp | ast.GeneratorExp) -> ast.AST:
        """A comprehension as a tuple of its entries; the length of one of the iterated tuples must be known."""
        (over,) = node.generators if len(node.generators) == 1 else (None,)
        if over is None or over.ifs or over.is_async:
            raise Untranslatable("a comprehension with conditions")
        call = over.iter
        zipped = isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "zip"
        sources = [self.visit(source) for source in (call.args if zipped and isinstance(call, ast.Call) else [call])]
        lengths = {len(source.elts) for source in sources if isinstance(source, ast.Tuple)}
        if len(lengths) != 1:
            raise Untranslatable("a comprehension over what has no known length")
        targets = list(over.target.elts) if zipped and isinstance(over.target, ast.Tuple) else [over.target]
        if len(targets) != len(sources) or not all(isinstance(target, ast.Name) for target in targets):
            raise Untranslatable("a comprehension over nested tuples")
        entries = []
        for k in range(lengths.pop()):
            each = [
                source.elts[k] if isinstance(source, ast.Tuple) else ast.Subscript(source, ast.Constant(k), ast.Load())
                for source in sources
            ]
            self.bound.append(
                {target.id: value for target, value in zip(targets, each) if isinstance(target, ast.Name)}
            )
            entries.append(self.visit(_parsed(ast.unparse(node.elt))))
            self.bound.pop()
        return ast.Tuple(entries, ast.Load())

    visit_GeneratorExp = visit_ListComp  # noqa: N815 (named by ast)

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

    def visit_BinOp(self, node: ast.BinOp | ast.AugAssign) -> ast.AST:
        """A binary operation or augmented assignment; powers have no translation."""
        if isinstance(node.op, ast.Pow | ast.MatMult):
            raise Untranslatable("a power")
        return self.generic_visit(node)

    visit_AugAssign = visit_BinOp  # noqa: N815 (named by ast)

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
        if all(isinstance(side, ast.Constant) for side in (made.left, *made.comparators)):
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
            return [made for line in (node.body if test.value else node.orelse) for made in self.statement(line)]
        body, other = ([made for line in part for made in self.statement(line)] for part in (node.body, node.orelse))
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


class Translated(NamedTuple):
    """Translated functions: name -> text, called ones before their callers; the last is `update`.

    Each takes `_r` and `_i`, the words as floating-point numbers and as integers, before its own arguments. `names`:
    other objects in the texts. `paths`: origins of the words, in order. `facts`: properties that the texts depend on.
    """

    functions: dict[str, str]
    names: dict[str, Any]
    paths: tuple[Path, ...]
    facts: tuple[tuple[Path, Any], ...]


def at_path(root: Any, path: Path) -> Any:
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
        value = at_path(root, path)
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
            value = at_path(self.root, path)
        except Exception as error:
            raise Untranslatable(f"{'.'.join(path)}: {error}") from error
        self.facts[path] = fact(value)
        return value

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
        assigned = (n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store))
        body = Body(self, function, own, owner or (), Counter([*arguments, *assigned]))
        lines = [line for statement in tree.body for line in body.statement(statement)]
        module = ast.Module([*lines, ast.Return(ast.Constant(None))] if not lines else lines, [])
        text = ast.unparse(ast.fix_missing_locations(module))
        self.functions[name] = f"def {name}({', '.join(['_r', '_i', *arguments])}):\n{textwrap.indent(text, '    ')}\n"
        return name


typeof: Any = _typeof  # without types of its own
_COMPILED: dict[Any, Any] = {}
"""Code compiled in this process: (update function, facts, type of the state) -> code, or None if compiling failed."""


class Native:
    """The compiled `update` of a controller in `state`. Raises Untranslatable if there is no translation.

    `address`: address of the C function `answer(line, t_ns, heard, command, memory)`; it returns 0 if it declines.
    `memory`: address of the controller's words and its state.
    """

    def __init__(self, controller: Controller, state: State) -> None:
        if gets_every_sample(controller):
            raise Untranslatable("it gets every sample of its sensors")
        self._like, size = state, sum(1 for _ in _state_words(state))
        self._paths, self._facts, self._code = _compiled_code(controller, state, size)
        self._first = len(words(controller, self._paths))
        self.memory = np.zeros(max(self._first + size, 1))
        self._whole = self.memory.view(np.int64)
        self.address: int = self._code.address
        self._controller: Controller | None = None
        classes: dict[str, Any] = {}
        text = _expression(state, count(self._first), classes)
        self._read: Callable[[list[float], list[int]], State] = eval(f"lambda _r, _i: {text}", classes)
        self._call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 5)(self.address)

    def resume(self, controller: Controller, state: State) -> bool:
        """Continue as this controller (it may have been retuned) from this state; False if the code does not fit it."""
        if controller is not self._controller:
            if not all(_holds(controller, path, expected) for path, expected in self._facts):
                return False
            self._controller = controller
            self._write_words(words(controller, self._paths), 0)
        if not _equal(self._like, state):
            return False
        self._write_words(_state_words(state), self._first)
        return True

    def _write_words(self, values: Iterable[float | int], first: int) -> None:
        for at, value in enumerate(values, first):
            (self._whole if isinstance(value, int) else self.memory)[at] = value

    def state(self) -> State:
        """The present state."""
        return self._read(self.memory.tolist(), self._whole.tolist())

    def reproduces(self, t_ns: int, values: Sequence[float], command: Values, state: State) -> bool:
        """Whether an update with `values` gives this command and state, to the last bit."""
        heard, answer = np.array(values, dtype=np.float64), np.zeros(len(command))
        answers = self._call(0, t_ns, heard.ctypes.data, answer.ctypes.data, self.memory.ctypes.data)
        given = np.array(command, dtype=np.float64)
        return bool(answers) and answer.tobytes() == given.tobytes() and repr(self.state()) == repr(state)


def _expression(like: State, at: Iterator[int], names: dict[str, Any]) -> str:
    """A state such as `like` as an expression of `_r` and `_i`; adds the classes in it to `names`."""
    if isinstance(like, tuple):
        entries = "".join(f"{_expression(entry, at, names)}, " for entry in like)
        if not hasattr(like, "_fields"):
            return f"({entries})"
        name = type(like).__name__
        if names.setdefault(name, type(like)) is not type(like):
            raise Untranslatable(f"{name} has two meanings")
        return f"{name}({entries})"
    if isinstance(like, complex):
        return f"complex(_r[{next(at)}], _r[{next(at)}])"
    if isinstance(like, bool):
        return f"(_i[{next(at)}] != 0)"
    return f"_i[{next(at)}]" if isinstance(like, int) else f"_r[{next(at)}]"


def _word_texts(like: State, text: str) -> Iterator[tuple[str, bool]]:
    """Expressions of all words of the state called `text`, and whether each is a number."""
    if isinstance(like, tuple):
        for k, entry in enumerate(like):
            yield from _word_texts(entry, f"{text}[{k}]")
    elif isinstance(like, complex):
        yield from ((f"{text}.real", True), (f"{text}.imag", True))
    else:
        yield text, not isinstance(like, int)


def _state_words(state: State) -> Iterator[float | int]:
    if isinstance(state, tuple):
        for entry in state:
            yield from _state_words(entry)
    elif isinstance(state, complex):
        yield from (state.real, state.imag)
    elif isinstance(state, int | float):
        yield int(state) if isinstance(state, int) else state
    else:
        raise Untranslatable(f"its state holds a {type(state).__name__}")


def _equal(a: State, b: State) -> bool:
    if type(a) is not type(b):
        return False
    return not isinstance(a, tuple) or (len(a) == len(b) and all(map(_equal, a, b)))


def _compiled_code(controller: Any, state: State, size: int) -> tuple[Any, Any, Any]:
    """Paths of the words, facts on which the code depends, compiled code."""
    key = type(controller).update, typeof(state)
    for paths, facts, code in _COMPILED.setdefault(key, []):
        if all(_holds(controller, path, expected) for path, expected in facts):
            if code is None:
                raise Untranslatable("it could not be compiled before")
            return paths, facts, code
    translated = translate(controller)
    try:
        with announce_compiling(f"controllers of class {type(controller).__name__}"):
            code = _compiled(controller, translated, state, size)
    except Exception as error:
        _COMPILED[key].append((translated.paths, translated.facts, None))
        raise Untranslatable(str(error).partition("\n")[0]) from error
    _COMPILED[key].append((translated.paths, translated.facts, code))
    return translated.paths, translated.facts, code


def _holds(controller: Any, path: tuple[str, ...], expected: Any) -> bool:
    try:
        return bool(fact(at_path(controller, path)) == expected)
    except (AttributeError, IndexError):
        return False


def _compiled(controller: Any, translated: Translated, state: State, size: int) -> Any:
    names: dict[str, Any] = {**translated.names}
    entry = _wrapped(controller, translated, state, size, names)
    for name, text in translated.functions.items():
        exec(text, names)
        names[name] = as_python(names[name])
    update = names[next(reversed(translated.functions))]
    array = types.Array(types.float64, 1, "C")
    heard = typeof((0.0,) * len(controller.reads))
    kinds = array, types.Array(types.int64, 1, "C"), typeof(state), types.int64, heard
    update.compile(kinds)
    returned: Any = update.overloads[kinds].signature.return_type
    if list(getattr(returned, "types", ()))[:1] != [typeof(state)]:
        raise Untranslatable(f"its state does not keep its type: {returned}")
    if len(returned[1]) != len(controller.drives):
        raise Untranslatable("it does not command its actuators")
    exec(entry, names)
    return called_by_address(names["answer"])


def _wrapped(controller: Any, translated: Translated, state: State, size: int, names: dict[str, Any]) -> str:
    """The source text of `answer`: it reads measurements and state, and writes command and state if both are finite."""
    first, reads, drives = len(words(controller, translated.paths)), len(controller.reads), len(controller.drives)
    names |= {"carray": carray, "isfinite": math.isfinite, "isnan": math.isnan, "int64": np.int64}
    update = next(reversed(translated.functions))
    measured = "".join(f"_h[{k}], " for k in range(reads))
    lines = [
        f"_r = carray(memory, ({max(first + size, 1)},))",
        "_i = _r.view(int64)",
        f"_h = carray(heard, ({max(reads, 1)},))",
        f"_c = carray(command, ({drives},))",
        f"for k in range({reads}):",
        "    if not isfinite(_h[k]):",
        "        return 0",
        "try:",
        f"    made = {update}(_r, _i, {_expression(state, count(first), names)}, t_ns, ({measured}))",
        "except Exception:",
        "    return 0",
        "state, given = made",
    ]
    words_out = list(_word_texts(state, "state"))
    for text in [f"isnan({text})" for text, real in words_out if real] + [
        f"not isfinite(given[{k}])" for k in range(drives)
    ]:
        lines += [f"if {text}:", "    return 0"]
    lines += [f"_c[{k}] = given[{k}]" for k in range(drives)]
    lines += [f"{'_r' if real else '_i'}[{at}] = {text}" for at, (text, real) in enumerate(words_out, first)]
    return "\n    ".join(["def answer(line, t_ns, heard, command, memory):", *lines, "return 1", ""])
