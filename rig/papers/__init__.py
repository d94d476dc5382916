"""The figures and tables of the papers, reproduced from scenes and compared with the published numbers."""

from __future__ import annotations

from rig.papers.entry import Comparison, Entry, Result
from rig.papers.gallery import gallery_page, gallery_tables, keep, kept, make, make_all, pick

__all__ = [
    "Comparison",
    "Entry",
    "Result",
    "gallery_page",
    "gallery_tables",
    "keep",
    "kept",
    "make",
    "make_all",
    "pick",
]
