"""The figures and tables of the papers, made again from scenes, with published or reference numbers beside ours.

Each entry is a function: it draws its axes and returns its comparisons. `ENTRIES` is the list, one file a paper.
"""

from __future__ import annotations

from rig.study.reproduce.entry import Comparison, Entry, Result, make, pick
from rig.study.reproduce.kept import keep
from rig.study.reproduce.page import page

__all__ = ["Comparison", "Entry", "Result", "keep", "make", "page", "pick"]
