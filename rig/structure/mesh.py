"""The nodes, node sets and outer faces of a mesh, from an input file of CalculiX or Abaqus, or from a CSV file.

    *NODE   *NSET (with GENERATE, with ELSET)   *ELEMENT   *ELSET   *SURFACE   *INCLUDE

A surface serves as the set of its nodes. A CSV file has the columns node, x, y, z. Other keywords are skipped. The
outer faces are those that belong to one element only. Shell elements are faces themselves.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.machine import files
from rig.structure.full import Array
from rig.units import brief

Numbers = NDArray[np.int64]
T = TypeVar("T")

LIMIT = 512 << 20
"""Largest file [bytes]."""
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Names of the directions 0 to 5 of a row."""
SHOWN = 5
"""Faults of one kind in one file that are listed."""
_DEPTH = 8  # of files that include each other
_EDGES = {  # midside node -> the ends of its edge, of elements with midside nodes; from zero
    10: {(0, 1): 4, (1, 2): 5, (0, 2): 6, (0, 3): 7, (1, 3): 8, (2, 3): 9},
    15: {(0, 1): 6, (1, 2): 7, (0, 2): 8, (3, 4): 9, (4, 5): 10, (3, 5): 11, (0, 3): 12, (1, 4): 13, (2, 5): 14},
    20: {(0, 1): 8, (1, 2): 9, (2, 3): 10, (0, 3): 11, (4, 5): 12, (5, 6): 13, (6, 7): 14, (4, 7): 15}
    | {(k, k + 4): 16 + k for k in range(4)},
}
_BRICK = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
_TETRAHEDRON = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
_WEDGE = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
_CORNERS = {4: _TETRAHEDRON, 6: _WEDGE, 8: _BRICK, 10: _TETRAHEDRON, 15: _WEDGE, 20: _BRICK}
_MOVED = ("PART", "INSTANCE", "SYSTEM", "TRANSFORM", "NGEN", "NCOPY", "NFILL", "NMAP", "ELGEN", "ELCOPY")
_TIED = (
    *("MPC", "TIE", "RIGID BODY", "COUPLING", "KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "NETWORK MPC"),
    *("CYCLIC SYMMETRY MODEL", "PRE-TENSION SECTION", "EMBEDDED ELEMENT", "SHELL TO SOLID COUPLING"),
)
_SOLID = re.compile(r"(?:C3D|SC)(4|6|8|10|15|20)(?!\d)")
_SHELL = re.compile(r"(?:S|STRI|M3D|SFM3D)(3|4|6|8)(?!\d)|STRI(6)5")
_FACELESS = re.compile(r"[BT][23]|PIPE|ELBOW|CP[ES]|CAX|SPRING|DASHPOT|MASS|ROTARYI|GAP|CONN|DCOUP|COH|R|[DFA]C?3D|D|U")
_LAYERED = re.compile(r"S\d|STRI|M3D|[BT][23]|C[PA]")  # CalculiX makes solids of them, with several rows of a node


@dataclass(frozen=True)
class Mesh:
    """Nodes `ids` [node], ascending, at `xyz` [node, 3] m; `sets`: name in capitals -> node numbers.

    `faces` [face, 8]: places in `ids`, corners first, then midside nodes; -1 beyond the last. `within` [face, 3]: the
    middle of the element, which is not a number for shells. `tied`: a keyword that makes nodes follow others;
    `following`: nodes that do by *EQUATION. `layered`: it has elements that CalculiX expands to solids, with several
    rows of one node and direction. `groups`: nodes of element sets, by name in capitals.
    """

    ids: Numbers
    xyz: Array
    sets: Mapping[str, Numbers] = field(default_factory=dict)
    faces: Numbers = field(default_factory=lambda: np.zeros((0, 8), dtype=np.int64))
    within: Array = field(default_factory=lambda: np.zeros((0, 3)))
    tied: str = ""
    following: frozenset[int] = frozenset()
    layered: bool = False
    groups: Mapping[str, Numbers] = field(default_factory=dict)

    def at(self, nodes: Numbers) -> Numbers:
        """The places in `ids` of node numbers that the mesh has."""
        return np.searchsorted(self.ids, nodes).astype(np.int64)

    def corners(self, moving: Numbers) -> NDArray[np.int32]:
        """The corners [face, 4] of faces with nodes among the numbers `moving`: places, the last twice for a triangle.

        A node without rows is held, unless it can follow others: then all nodes of a face must be `moving`.
        """
        three = np.isin((self.faces >= 0).sum(axis=1), (3, 6))
        corners = np.where(np.arange(4) < np.where(three, 3, 4)[:, None], self.faces[:, :4], self.faces[:, 2:3])
        known = np.isin(self.ids, moving)[corners]
        return corners[known.all(axis=1) if self.tied or self.following else known.any(axis=1)].astype(np.int32)

    def unknown(self, nodes: Numbers) -> Numbers:
        """Those of these node numbers that the mesh does not have."""
        return nodes[~np.isin(nodes, self.ids)]


NOTHING = Mesh(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


@dataclass(frozen=True)
class Selection:
    """Nodes by the name of a `set`, by their numbers, or in a `box`: two opposite corners [m]."""

    set: str = ""
    nodes: tuple[int, ...] = ()
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None

    def of(self, mesh: Mesh) -> Numbers:
        """The numbers of the nodes, ascending. Raises SceneError for none, or for nodes that the mesh does not have."""
        if self.set:
            if self.set.upper() not in mesh.sets:
                near = get_close_matches(self.set.upper(), mesh.sets, 3) or sorted(mesh.sets)[:8]
                names = ", ".join(near) or "none"
                raise SceneError("", [f"the mesh has no node set {brief(self.set)}; it has: {names}"])
            return mesh.sets[self.set.upper()]
        if self.box is None:
            nodes = np.unique(np.array(self.nodes, dtype=np.int64))
            if len(missing := mesh.unknown(nodes)):
                raise SceneError(
                    "", [f"the mesh has no node {missing[0]}" + f" and {len(missing) - 1} others" * (len(missing) > 1)]
                )
            if not len(nodes):
                raise SceneError("", ["no nodes are given; name a set, nodes, or a box"])
            return nodes
        ends = np.sort(np.array(self.box, dtype=float), axis=0)
        slack = 1e-9 * np.ptp(mesh.xyz, axis=0).max() if len(mesh.xyz) else 0.0
        inside = ((mesh.xyz >= ends[0] - slack) & (mesh.xyz <= ends[1] + slack)).all(axis=1)
        if not inside.any():
            size = ", ".join(
                f"{low:.4g} to {high:.4g} m" for low, high in zip(mesh.xyz.min(axis=0), mesh.xyz.max(axis=0))
            )
            raise SceneError("", [f"no node lies in the box; the mesh extends over {size}"])
        return mesh.ids[inside]  # type: ignore[no-any-return]


def direction_number(text: str) -> int:
    """The direction, from one, of "x", "rx" or "1" to "6". Raises ValueError."""
    number = DIRECTIONS.index(text) + 1 if text in DIRECTIONS else int(text)
    if not 1 <= number <= 6:
        raise ValueError(text)
    return number


def readable(path: Path) -> None:
    """Raise SceneError for a file that is missing, no regular file, or too large."""
    try:
        size = files.regular(path)
    except OSError as error:
        raise SceneError("", [f"{path.name}: cannot be read: {error.strerror} ({path})"]) from None
    if size > LIMIT:
        raise SceneError("", [f"{path.name}: has {size / (1 << 20):.0f} MB; at most {LIMIT >> 20} MB are read"])


def lines_of(path: Path) -> Iterator[str]:
    """The lines of a text file. Raises SceneError as `readable` does."""
    readable(path)
    with path.open(encoding="utf-8-sig", errors="replace") as file:  # Excel begins with a mark
        yield from file


def included(path: Path, depth: int = 0) -> Iterator[Path]:
    """An input file and all that it includes. Raises SceneError as `readable` does."""
    yield path
    for line in lines_of(path) if depth < _DEPTH and path.suffix.lower() != ".csv" else ():
        if line.lower().startswith("*include"):
            yield from included(path.parent / _keyword(line.strip())[1].get("INPUT", ""), depth + 1)


def tried(read: Callable[[], T], otherwise: T, faults: list[str], of: str = "") -> T:
    """Return what `read` returns; `otherwise` if it raises SceneError, whose faults are kept."""
    try:
        return read()
    except SceneError as error:
        faults.extend(of + fault for fault in error.faults)
        return otherwise


def few(faults: list[str], what: str) -> list[str]:
    """The first faults of a file, and how many more there are."""
    more = len(faults) - SHOWN
    return [*faults[:SHOWN], *([f"{what}: {more} more faults of this kind"] if more > 0 else [])]


def read_mesh(path: Path, length: float) -> Mesh:
    """The mesh of a file whose coordinates are in `length` m. Raises SceneError with every fault."""
    deck = _Deck()
    if path.suffix.lower() == ".csv":
        deck.read_csv(path)
    else:
        deck.read(path, 0)
    if not deck.nodes and not deck.faults:
        deck.faults.append(f"{path.name}: has no nodes (*NODE)")
    ids = np.array(sorted(deck.nodes), dtype=np.int64)
    sets: dict[str, Numbers] = {}
    for name, members in {**deck.surfaces, **deck.sets}.items():
        sets[name] = np.unique(np.array(sorted(members), dtype=np.int64))
        if missing := sorted(members - deck.nodes.keys()):
            deck.faults.append(f"{path.name}: set {name} contains node {missing[0]}, which is not in the mesh")
    for number, (_, corners) in deck.elements.items():
        if missing := sorted(set(corners) - deck.nodes.keys()):
            deck.faults.append(f"{path.name}: element {number} has node {missing[0]}, which is not in the mesh")
    if deck.faults:
        raise SceneError("", few(deck.faults, path.name))
    xyz = np.array([deck.nodes[number] for number in ids.tolist()]) * length
    groups: dict[str, Numbers] = {}
    for name, elements in deck.groups.items():
        nodes = [np.array(deck.elements[number][1]) for number in sorted(elements & deck.elements.keys())]
        groups[name] = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *nodes]))
    faces, within = _faces(deck.elements, ids, xyz)
    following = frozenset(deck.following)
    return Mesh(ids, xyz, sets, faces, within, deck.tied, following, deck.layered, groups)


class _Deck:
    """What the lines of an input file define; `elements`: number -> whether it is a shell, and its nodes."""

    def __init__(self) -> None:
        self.nodes: dict[int, tuple[float, float, float]] = {}
        self.sets: dict[str, set[int]] = {}
        self.groups: dict[str, set[int]] = {}  # elements
        self.surfaces: dict[str, set[int]] = {}
        self.elements: dict[int, tuple[bool, tuple[int, ...]]] = {}
        self.faults: list[str] = []
        self.tied = ""
        self.following: set[int] = set()
        self.kind: tuple[bool, int] | None = None  # of the elements that follow
        self.layered = False

    def read_csv(self, path: Path) -> None:
        for number, line in enumerate(lines_of(path), 1):
            words = re.split(r"[,;]\s*", line.strip())
            if any(words) and not (number == 1 and words[0].strip('"').lower() == "node"):
                self._kept(path, number, line, lambda words=words: self._node(words, 4))

    def read(self, path: Path, depth: int) -> None:
        keyword = ""
        options = dict[str, str]()
        pending = list[str]()
        continued = ""
        for number, raw in enumerate(lines_of(path), 1):
            line = raw.strip()
            if not line or line.startswith("**"):
                continue
            if line.startswith("*") or continued:
                line = continued + line
                if line.endswith(","):  # the keyword goes on in the next line
                    continued = line
                    continue
                continued = ""
                pending = []
                keyword, options = _keyword(line)
                self._kept(path, number, line, lambda k=keyword, o=options: self._opened(path, depth, k, o))
                continue
            words = [word.strip() for word in line.rstrip(",").split(",")]
            if keyword == "NODE":
                self._kept(path, number, line, lambda w=words, o=options: self._node(w, 1, o.get("NSET", "")))
            elif keyword == "EQUATION":
                pending += words
                if not pending[0].isdigit() or len(pending) > 3 * int(pending[0]):  # node, direction, factor of each
                    self._kept(path, number, line, lambda w=pending: self._follows(w[1]))
                    pending = []
            elif keyword in ("NSET", "ELSET"):
                self._kept(path, number, line, lambda w=words, k=keyword, o=options: self._set(k, w, o))
            elif keyword == "SURFACE":
                self._kept(path, number, line, lambda w=words, o=options: self._surface(w, o))
            elif keyword == "ELEMENT" and self.kind:
                pending += words
                if len(pending) > self.kind[1]:
                    self._kept(path, number, line, lambda w=pending, o=options, k=self.kind: self._element(w, k, o))
                    pending = []

    def _kept(self, path: Path, number: int, line: str, action: object) -> None:
        """Do `action`; a fault names the line."""
        try:
            action()  # type: ignore[operator]
        except SceneError as error:
            self.faults.extend(error.faults)
        except (ValueError, IndexError, OverflowError) as error:
            why = f": {error}" if type(error) is _Wrong else ""
            self.faults.append(f"{path.name}, line {number}: {brief(line.strip())} cannot be read{why}")

    def _opened(self, path: Path, depth: int, keyword: str, options: Mapping[str, str]) -> None:
        if keyword == "INCLUDE":
            if depth == _DEPTH:
                raise _Wrong("files include each other")
            self.read(path.parent / options["INPUT"] if "INPUT" in options else Path(), depth + 1)
        elif keyword in _MOVED:
            raise _Wrong(f"*{keyword} makes or moves nodes; write a flat input file with every node and element")
        elif keyword == "ELEMENT":
            self.kind = _kind(options.get("TYPE", "").upper())
            self.layered |= bool(_LAYERED.match(options["TYPE"].upper()))
        elif keyword in _TIED:
            self.tied = f"*{keyword}"
        elif keyword == "NSET" and "ELSET" in options:
            for number in self.groups.get(options["ELSET"].upper(), ()):
                self.sets.setdefault(options["NSET"].upper(), set()).update(self.elements[number][1])

    def _node(self, words: list[str], least: int, name: str = "") -> None:
        if not least <= len(words) <= 4 and least > 1:
            raise _Wrong("expected node, x, y, z")
        number = int(words[0])
        x, y, z = [float(word or 0.0) for word in (*words[1:4], "", "", "")[:3]]
        if not np.isfinite((x, y, z)).all():
            raise _Wrong("a coordinate is not finite")
        if number in self.nodes and self.nodes[number] != (x, y, z):
            raise _Wrong(f"node {number} has another place before")
        self.nodes[number] = (x, y, z)
        if name:
            self.sets.setdefault(name.upper(), set()).add(number)

    def _set(self, keyword: str, words: list[str], options: Mapping[str, str]) -> None:
        known = self.sets if keyword == "NSET" else self.groups
        if keyword not in options:
            raise _Wrong(f"*{keyword} has no name, {keyword}=...")
        members = known.setdefault(options[keyword].upper(), set())
        if "GENERATE" in options:
            first, last, step = [int(word) for word in (*words, "1")[:3]]
            if not (step > 0 and 0 <= last - first <= 100_000_000):
                raise _Wrong("expected first, last, step")
            members.update(range(first, last + 1, step))
            return
        for word in filter(None, words):
            if word.lstrip("-").isdigit():
                members.add(int(word))
            elif word.upper() in known:
                members.update(known[word.upper()])
            else:
                raise _Wrong(f"set {word} is not defined before")

    def _follows(self, node: str) -> None:
        """The first node of an equation, or the nodes of a set, depend on the others."""
        self.following.update(self.sets[node.upper()] if node.upper() in self.sets else {int(node)})

    def _surface(self, words: list[str], options: Mapping[str, str]) -> None:
        """Nodes, or faces of elements: the set of that name, unless there is a node set of this name."""
        if not options.get("NAME") or options.get("TYPE", "ELEMENT").upper() not in ("NODE", "ELEMENT"):
            raise _Wrong("expected *SURFACE, NAME=..., TYPE=NODE or TYPE=ELEMENT; or write a node set")
        first, face = (*words, "")[:2]
        members = self.surfaces.setdefault(options["NAME"].upper(), set())
        numbers = {int(first)} if first.isdigit() else None
        if options.get("TYPE", "").upper() == "NODE":
            numbers = self.sets.get(first.upper()) if numbers is None else numbers
            members.update(numbers or ())
        else:
            numbers = self.groups.get(first.upper()) if numbers is None else numbers
            for number in numbers or ():
                members.update(self._face(number, face.upper()))
        if numbers is None:
            raise _Wrong(f"set {first} is not defined before")

    def _face(self, number: int, face: str) -> list[int]:
        """The nodes of a face of an element, S1 to S6, or of a side of a shell."""
        if number not in self.elements:
            raise _Wrong(f"element {number} is not defined before, or has no faces")
        shell, nodes = self.elements[number]
        corners = () if shell else _CORNERS[len(nodes)]
        if shell and face in ("SPOS", "SNEG"):
            return list(nodes)
        if face not in (names := [f"S{k}" for k in range(1, len(corners) + 1)]):
            raise _Wrong(f"a face of element {number} is {'SPOS or SNEG' if shell else ', '.join(names)}")
        own = corners[int(face[1:]) - 1]
        edges = _EDGES.get(len(nodes), {})
        middles = [middle for ends, middle in edges.items() if {*ends} <= {*own}]
        return [nodes[k] for k in (*own, *middles)]

    def _element(self, words: list[str], kind: tuple[bool, int], options: Mapping[str, str]) -> None:
        number, *nodes = [int(word) for word in words]
        if len(nodes) != kind[1]:
            raise _Wrong(f"expected {kind[1]} nodes")
        self.elements[number] = (kind[0], tuple(nodes))
        if "ELSET" in options:
            self.groups.setdefault(options["ELSET"].upper(), set()).add(number)


class _Wrong(ValueError):
    """What is wrong with a line, in words."""


def _keyword(line: str) -> tuple[str, dict[str, str]]:
    """The keyword of a line in capitals, and its options."""
    head, *rest = [part.strip() for part in line[1:].split(",")]
    pairs = [part.partition("=") for part in rest if part]
    return re.sub(r"\s+", " ", head.upper()), {
        name.strip().upper(): value.strip().strip('"') for name, _, value in pairs
    }


def _kind(element: str) -> tuple[bool, int] | None:
    """Whether an element type is a shell, and its number of nodes; None for one without faces. Raises _Wrong."""
    for pattern, shell in ((_SOLID, False), (_SHELL, True)):
        if match := pattern.match(element):
            return shell, int(match[match.lastindex or 0])
    if not _FACELESS.match(element):
        raise _Wrong("this element type is not known; use others, or leave its elements out of the file of the mesh")
    return None


def _faces(elements: Mapping[int, tuple[bool, tuple[int, ...]]], ids: Numbers, xyz: Array) -> tuple[Numbers, Array]:
    """The outer faces and the middles of their elements, as in `Mesh`."""
    seen: dict[tuple[int, ...], tuple[tuple[int, ...], int]] = {}
    shared: set[tuple[int, ...]] = set()
    for number, (shell, nodes) in elements.items():
        edges = _EDGES.get(len(nodes), {})
        for corners in (tuple(range(len(nodes))),) if shell else _CORNERS[len(nodes)]:
            ends = zip(corners, (*corners[1:], corners[0])) if edges and not shell else ()
            middles = [edges[min(i, j), max(i, j)] for i, j in ends]
            face = tuple(nodes[k] for k in (*corners, *middles))
            key = tuple(sorted(face))
            if key in seen and not shell:
                shared.add(key)
            seen[key] = (face, 0 if shell else number)
    outer = [face for key, face in seen.items() if key not in shared]
    faces = np.full((len(outer), 8), -1, dtype=np.int64)
    within = np.full((len(outer), 3), np.nan)
    for row, (face, number) in enumerate(outer):
        faces[row, : len(face)] = np.searchsorted(ids, face)
        if number:
            within[row] = xyz[np.searchsorted(ids, elements[number][1])].mean(axis=0)
    return faces, within
