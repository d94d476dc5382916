"""Reads a linear system from a file (.json, .npz, .mat) or from python-control.

    A, B, C, D        state space, row by row; leave out A, B and C for a constant gain
    num, den          transfer function: coefficients of falling powers; with several inputs or outputs one list of
                      coefficients for each output and input, num[output][input]
    dt                sample period [s], 0 for a continuous system
    inputs, outputs   optional: names of the signals

All functions raise ValueError with everything that is wrong.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.machine.files import contents, matlab_checked, unpacked
from rig.units import brief

Matrix = NDArray[np.float64]

STATES = 100
"""Most states of a controller. # chosen"""
SIGNALS = 16
"""Most inputs or outputs of a controller. # chosen"""
_LARGEST = 1 << 24  # bytes
_KEYS = ("A", "B", "C", "D", "num", "den", "dt", "inputs", "outputs")
_AS_MATRICES = "save its matrices: [A, B, C, D] = ssdata(K); dt = K.Ts; save('K.mat', 'A', 'B', 'C', 'D', 'dt', '-v7')"


class System(NamedTuple):
    """x(k+1) = A x + B y, u = C x + D y for `dt` > 0 [s]; x' = A x + B y for `dt` 0. The names may be empty."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    dt: float
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()


def read(path: Path) -> System:
    """The system in a file."""
    if path.suffix not in READERS:
        raise ValueError(f"{path.name}: the name of a linear system ends in {', '.join(READERS)}")
    try:
        values = READERS[path.suffix](contents(path, _LARGEST))
    except FileNotFoundError:
        raise ValueError(f"{path}: there is no such file") from None
    except OSError as fault:
        raise ValueError(f"{path}: cannot be read: {fault.strerror or fault}") from None
    except NotImplementedError:  # scipy's, for MATLAB's format 7.3
        raise ValueError(f"{path.name}: is in MATLAB's format 7.3, which is not read here; {_AS_MATRICES}") from None
    except Exception as fault:  # of libraries that read damaged files, of many kinds
        raise ValueError(f"{path.name}: cannot be read: {fault!s:.200}") from None
    return system(values, path.name)


def _json(data: bytes) -> dict[str, Any]:
    values = json.loads(data)
    if not isinstance(values, dict):
        raise ValueError("it is not a JSON object")
    return values


def _npz(data: bytes) -> dict[str, Any]:
    if zipfile.is_zipfile(io.BytesIO(data)):
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked(archive, _LARGEST)
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        if not hasattr(file, "files"):
            raise ValueError("it holds one array without a name; write it with numpy.savez")
        return {name: file[name].tolist() for name in file.files}


def _mat(data: bytes) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabFunction, MatlabOpaque

    matlab_checked(data, _LARGEST)
    variables = {name: value for name, value in loadmat(io.BytesIO(data)).items() if not name.startswith("__")}
    if any(isinstance(value, MatlabFunction | MatlabOpaque) for value in variables.values()) or "None" in variables:
        raise ValueError(f"it holds an object of MATLAB; {_AS_MATRICES}")
    read = {"dt" if name == "Ts" else name: _plain(value) for name, value in variables.items()}
    for name in {"num", "den"} & read.keys():
        if np.ndim(read[name]) == 2 and len(read[name]) == 1:  # MATLAB has no vectors
            read[name] = read[name][0]
    return read


def _plain(value: Any) -> Any:
    """A value of a .mat file: matrices as lists of rows, cells as lists, texts as texts."""
    if value.dtype == object:
        return [list(map(_cell, row)) for row in value]
    if value.dtype.kind == "U":
        return value.tolist()
    return value.item() if value.size == 1 else value.tolist()


def _cell(content: Any) -> Any:
    """The content of a cell; of a matrix with one row this row."""
    plain = _plain(content)
    return plain[0] if isinstance(plain, list) and len(plain) == 1 else plain


READERS: dict[str, Callable[[bytes], dict[str, Any]]] = {".json": _json, ".npz": _npz, ".mat": _mat}
"""Suffix of a file -> what reads it."""


def of_control(given: Any) -> System:
    """The system in a StateSpace or TransferFunction of python-control."""
    import control

    if isinstance(given, control.TransferFunction):
        numerators = given.num_list
        denominators = given.den_list
        values: dict[str, Any] = {"num": _coefficients(numerators), "den": _coefficients(denominators)}
    elif isinstance(given, control.StateSpace):
        values = {name: getattr(given, name).tolist() for name in "ABCD"}
    else:
        raise ValueError(
            f"a {type(given).__name__} of python-control is not a linear system with a matrix form; "
            "give a StateSpace or a TransferFunction"
        )
    names = {"inputs": _chosen(given.input_labels, "u"), "outputs": _chosen(given.output_labels, "y")}
    return system({**values, "dt": given.dt, **names}, f"the {type(given).__name__}")


def _coefficients(polynomials: Any) -> list[list[list[float]]]:
    """Coefficients of a matrix of polynomials as plain numbers."""
    rows = []
    for row in polynomials:
        rows.append([polynomial.tolist() for polynomial in row])
    return rows


def _chosen(labels: list[str], letter: str) -> list[str]:
    """The labels of signals; none if they are those that python-control gives: u[0], u[1]."""
    given = [f"{letter}[{i}]" for i in range(len(labels))]
    return [] if labels == given else labels


def system(values: Mapping[str, Any], where: str) -> System:
    """The system that these values describe; `where`: what contains them, for messages."""
    if "E" in values:
        raise ValueError(f"{where}: is a descriptor system (E): solve its algebraic equations and state A, B, C, D")
    faults = [f"{key!r:.60} is unknown; known: {', '.join(_KEYS)}" for key in values if key not in _KEYS]
    names = []
    for key in ("inputs", "outputs"):
        try:
            names.append(_names(values.get(key)))
        except ValueError as fault:
            faults.append(f"{key} {fault}")
    dt = values.get("dt")
    if dt is None or isinstance(dt, bool) or not isinstance(dt, int | float) or not (math.isfinite(dt) and dt >= 0.0):
        given = "is missing" if dt is None else f"= {brief(dt)}"
        faults.append(f"dt {given}: state the sample period [s], or 0 for a continuous system")
    matrices: tuple[Matrix, Matrix, Matrix, Matrix] | None = None
    try:
        matrices = _fraction(values) if "num" in values or "den" in values else _state_space(values)
        outputs, inputs = matrices[3].shape
        states = len(matrices[0])
        if states > STATES or max(inputs, outputs) > SIGNALS:
            raise ValueError(
                f"has {states} states, {inputs} inputs and {outputs} outputs; at most {STATES} states and {SIGNALS} "
                "inputs or outputs are possible"
            )
        for key, labels, count in zip(("inputs", "outputs"), names, (inputs, outputs)):
            if labels and len(labels) != count:
                faults.append(f"{key}: {len(labels)} names; the system has {count}")
    except ValueError as fault:
        faults.append(str(fault))
    if faults or matrices is None:
        raise ValueError("; ".join(f"{where}: {fault}" for fault in faults))
    return System(*matrices, float(dt), *names)  # type: ignore[arg-type]  # no faults: a number


def _names(given: Any) -> tuple[str, ...]:
    flat = [given] if isinstance(given, str) else given or []
    if isinstance(flat, list) and flat and all(isinstance(label, list) for label in flat):  # a row or column of cells
        flat = [label for row in flat for label in row]
    if not isinstance(flat, list) or not all(isinstance(label, str) for label in flat):
        raise ValueError(f"= {brief(given)}: expected a list of names")
    return tuple(label.strip() for label in flat)


def _numbers(given: Any, name: str) -> Matrix:
    """A matrix of finite numbers."""
    try:
        made = np.array(given)
        if made.dtype.kind not in "iuf" and made.size:
            raise ValueError
        made = made.astype(np.float64)
    except ValueError:
        raise ValueError(f"{name} = {brief(given)}: expected rows of real numbers, all of one length") from None
    if not np.isfinite(made).all():
        raise ValueError(f"{name} contains a number that is not finite")
    return made


def _state_space(values: Mapping[str, Any]) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    missing = [name for name in "ABCD" if name not in values]
    if missing not in ([], ["A", "B", "C"]):
        are = "is" if len(missing) == 1 else "are"
        raise ValueError(f"{', '.join(missing)} {are} missing; state A, B, C, D, or num and den, or D alone for a gain")
    d = np.atleast_2d(_numbers(values["D"], "D"))
    outputs, inputs = d.shape
    if missing or not any(_numbers(values[name], name).size for name in "ABC"):
        return np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), d
    a = np.atleast_2d(_numbers(values["A"], "A"))
    states = len(a)
    b = _numbers(values["B"], "B")
    c = _numbers(values["C"], "C")
    if b.ndim < 2:
        b = b.reshape(states, -1) if b.size == states * inputs else np.atleast_2d(b)
    c = np.atleast_2d(c)
    expected = (("A", a, (states, states)), ("B", b, (states, inputs)), ("C", c, (outputs, states)))
    wrong = []
    for name, matrix, shape in expected:
        if matrix.shape != shape:
            wrong.append(f"{name} is {_size(matrix.shape)}, expected {_size(shape)}")
    if wrong:
        raise ValueError(f"{'; '.join(wrong)} (D is {outputs} x {inputs})")
    return a, b, c, d


def _size(shape: tuple[int, ...]) -> str:
    """A shape in words: "2 x 3"."""
    return " x ".join(map(str, shape))


def _fraction(values: Mapping[str, Any]) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """A transfer function in state space: the controllable canonical form of each entry."""
    if missing := [name for name in ("num", "den") if name not in values]:
        raise ValueError(f"{missing[0]} is missing; state num and den, or A, B, C, D")
    entries = []
    for name in ("num", "den"):
        given = values[name]
        row = isinstance(given, list) and not any(isinstance(entry, list) for entry in given)
        entries.append([[given]] if row or isinstance(given, int | float) else given)
    num, den = entries
    rows = [len(row) if isinstance(row, list) else -1 for row in (*num, *den)]
    if len(num) != len(den) or not num or len({*rows}) != 1 or rows[0] < 1:
        raise ValueError("num and den differ in their numbers of outputs and inputs")
    outputs = len(num)
    inputs = rows[0]
    of_states = list[Matrix]()
    of_inputs = list[Matrix]()
    of_outputs = list[Matrix]()
    direct = np.empty((outputs, inputs))
    from scipy.linalg import block_diag

    for i in range(outputs):
        places = [f"[{i + 1}][{j + 1}]" if outputs * inputs > 1 else "" for j in range(inputs)]
        a, b, c, d = zip(*map(_canonical, num[i], den[i], places))
        of_states += a
        of_inputs.append(block_diag(*b))
        of_outputs.append(np.hstack(c))
        direct[i] = d
    return block_diag(*of_states), np.concatenate(of_inputs), block_diag(*of_outputs), direct


def _polynomial(given: Any, name: str) -> Matrix:
    """The coefficients of a polynomial, the first not zero."""
    coefficients: Matrix = np.trim_zeros(np.atleast_1d(_numbers(given, name)).ravel(), "f")
    return coefficients


def _canonical(num: Any, den: Any, place: str) -> tuple[Matrix, Matrix, Matrix, float]:
    """The controllable canonical form of one entry."""
    above = _polynomial(num, f"num{place}")
    below = _polynomial(den, f"den{place}")
    if not below.size:
        raise ValueError(f"den{place} is zero")
    if above.size > below.size:
        raise ValueError(
            f"is improper{f' at {place}' if place else ''}: num has degree {above.size - 1}, den {below.size - 1}; add "
            "a pole, such as a low-pass filter"
        )
    above = np.pad(above, (below.size - above.size, 0)) / below[0]
    below = below / below[0]
    count = below.size - 1
    a = np.vstack([-below[1:], np.eye(count)[:-1]]) if count else np.zeros((0, 0))
    return a, np.eye(count, 1), (above[1:] - above[0] * below[1:])[None], float(above[0])
