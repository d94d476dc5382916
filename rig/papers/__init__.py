"""The figures and tables of the papers, made again from scenes, with published or reference numbers beside ours.

Each entry is a function: it draws its axes and returns its comparisons. `ENTRIES` is the list, one file a paper.
"""

from __future__ import annotations

from rig.papers.entry import Comparison, Entry, Result, make, pick
from rig.papers.gallery_page import page
from rig.papers.numbers_file import keep

__all__ = ["Comparison", "Entry", "Result", "keep", "make", "page", "pick"]
