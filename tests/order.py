"""Constants stand above the functions and classes of a module: what `make check` asks of rig.

A constant below them is one that is made of them, or one that stands directly below the class that it belongs to.
"""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
DEFINES = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


def constant(statement):
    """The name of the constant that a statement assigns; "" if it assigns none."""
    targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
    name = targets[0].id if isinstance(targets[0], ast.Name) else ""
    return name if name.lstrip("_").isupper() else ""


def misplaced(text):
    """(line, name) of each constant of a module that stands too low."""
    defined, below_a_class = set(), False
    for statement in ast.parse(text).body:
        if isinstance(statement, DEFINES):
            defined.add(statement.name)
            below_a_class = isinstance(statement, ast.ClassDef)
        elif name := constant(statement):
            used = {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)} - {name}
            if used & defined:
                defined.add(name)
            elif defined and not below_a_class:
                yield statement.lineno, name
        elif isinstance(statement, ast.Assign | ast.AnnAssign) and defined:  # a type that is made of classes
            names = (node for node in ast.walk(statement) if isinstance(node, ast.Name))
            defined |= {node.id for node in names if isinstance(node.ctx, ast.Store)}
        elif not isinstance(statement, ast.Expr):  # a docstring of a constant parts nothing
            below_a_class = False


def main():
    """Print the constants that stand too low; exit code 1 if there are some."""
    told = [
        f"{path.relative_to(ROOT)}:{line}: {name} stands below a function or class: constants come first"
        for path in sorted((ROOT / "rig").rglob("*.py"))
        for line, name in misplaced(path.read_text(encoding="utf-8"))
    ]
    sys.stdout.write("".join(f"{line}\n" for line in told))
    sys.exit(bool(told))


if __name__ == "__main__":
    main()
