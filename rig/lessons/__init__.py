"""Lessons: pages with questions, commands and expected numbers, which `rig lesson` prints.

page       a page in parts: question, text, commands, their output, expected numbers, solutions
run        runs a command of a lesson; replaces the lines of its page by what it prints
numbers    the expected numbers beside those of a report
pages/     the pages themselves, with their figures: docs/lessons
"""

from __future__ import annotations

from rig.lessons.numbers import Compared, compare
from rig.lessons.page import FOLDER, SECTIONS, Command, Expected, Lesson, lesson, lessons, readable
from rig.lessons.run import Outcome, attempt, prepared, renew, renewed

__all__ = [
    "FOLDER",
    "SECTIONS",
    "Command",
    "Compared",
    "Expected",
    "Lesson",
    "Outcome",
    "attempt",
    "compare",
    "lesson",
    "lessons",
    "prepared",
    "readable",
    "renew",
    "renewed",
]
