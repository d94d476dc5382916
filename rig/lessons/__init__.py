"""Lessons: pages with questions, commands and expected numbers, which `rig lesson` shows step by step.

page       a page in parts: question, text, commands, their output, expected numbers, solutions; runs a command of a
           lesson and compares its report with the expected numbers
pages/     the pages themselves, with their figures: docs/lessons
"""

from __future__ import annotations

from rig.lessons.page import (
    FOLDER,
    Command,
    Expected,
    Found,
    Lesson,
    Outcome,
    attempt,
    compare,
    lesson,
    lessons,
    readable,
    renew,
    renewed,
)

__all__ = [
    "FOLDER", "Command", "Expected", "Found", "Lesson", "Outcome", "attempt", "compare", "lesson", "lessons",
    "readable", "renew", "renewed",
]  # fmt: skip
