"""Lessons: pages with questions, commands and expected numbers, which `rig lesson` prints.

page       a page in parts: question, text, commands, their output, expected numbers, solutions; runs a command of a
           lesson
pages/     the pages themselves, with their figures: docs/lessons
"""

from __future__ import annotations

from rig.lessons.page import (
    FOLDER,
    Command,
    Expected,
    Lesson,
    Outcome,
    attempt,
    lesson,
    lessons,
    readable,
    renew,
    renewed,
)

__all__ = [
    "FOLDER", "Command", "Expected", "Lesson", "Outcome", "attempt", "lesson", "lessons",
    "readable", "renew", "renewed",
]  # fmt: skip
