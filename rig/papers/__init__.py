"""The figures and tables of the papers, reproduced from scenes and compared with the published numbers."""

from __future__ import annotations

from rig.papers.entry import Comparison, Entry, Result, make, pick
from rig.papers.gallery import keep, make_all, page

__all__ = ["Comparison", "Entry", "Result", "keep", "make", "make_all", "page", "pick"]
