"""Dates and times of day as texts of measurement files have them, in nanoseconds.

The order of day and month in a date with slashes or dashes follows from the texts: a field beyond 12 is the day, and AM
or PM belongs to the order of the United States. Otherwise the order is open, and only times of one date can be read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import date

from rig.errors import UsageError

DAY_NS = 86_400_000_000_000
OPEN, DAY_FIRST, MONTH_FIRST = "open", "day", "month"
"""Orders of a date with slashes."""
_1970 = date(1970, 1, 1).toordinal()
_CENTURY = 70  # a year of two digits from here on is of the 20th century, as POSIX has it for 69 and above. chosen
_LEAP = 60  # the highest second, of a leap second
# Beginnings of the names of months, English and German -> number
_MONTHS = {
    **{name: i for i, name in enumerate("jan feb mar apr may jun jul aug sep oct nov dec".split(), 1)},
    **{"mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12},
}
_NAME = rf"(?:{'|'.join(_MONTHS)})[a-zä]*\.?"
_DATE = (
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)"
    r"|(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4}|\d\d)"
    r"|(?P<first>\d\d?)(?P<mark>[/-])(?P<second_field>\d\d?)(?P=mark)(?P<last>\d{4}|\d\d)"
    rf"|(?P<named_day>\d\d?)\.?[- ](?P<name>{_NAME})[- ](?P<named_year>\d{{4}}|\d\d)"
    rf"|(?P<first_name>{_NAME}) (?P<second_day>\d\d?),? (?P<third_year>\d{{4}}))"
)
_CLOCK = (
    r"(?:(?P<hour>\d\d?):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,](?P<part>\d{1,12})|:(?P<ms>\d{3}))?)?"
    r"|(?P<only_minute>\d\d?):(?P<only_second>\d\d)[.,](?P<only_part>\d{1,12}))"
    r"\s?(?P<half>[ap]\.?m\.?)?\s?(?P<zone>Z|UTC|GMT|[-+]\d\d(?::?\d\d)?)?"
)
# Without a time of day behind it, it is a number
_COMPACT = r"(?P<compact_year>\d{4})(?P<compact_month>\d\d)(?P<compact_day>\d\d)"
_WHOLE_DATE = re.compile(_DATE, re.IGNORECASE)
_TIME = re.compile(rf"(?:(?:{_DATE}|{_COMPACT})(?:[T ]|,\s)\s*)?{_CLOCK}", re.IGNORECASE)


def is_time(text: str) -> bool:
    """Whether a text is a time of day, with or without a date."""
    return ":" in text and _TIME.fullmatch(text) is not None


def is_valid(text: str, of_dates: str) -> bool:
    """Whether a text is a time of day whose fields are possible."""
    try:
        nanoseconds(text, of_dates)
    except UsageError:
        return False
    return True


def is_date(text: str) -> bool:
    """Whether a text is a date without a time of day."""
    return _WHOLE_DATE.fullmatch(text) is not None


def has_date(text: str) -> bool:
    """Whether a time of day has a date."""
    match = _TIME.fullmatch(text)
    return _WHOLE_DATE.match(text) is not None or (match is not None and match["compact_year"] is not None)


def is_short(text: str) -> bool:
    """Whether a time has two fields only and nothing that tells which: hours and minutes, or minutes and seconds."""
    match = _TIME.fullmatch(text)
    if match is None or match["only_minute"]:
        return False
    return not (match["second"] or match["half"] or match["zone"] or has_date(text))


def order(texts: Iterable[str]) -> str:
    """The order of day and month in the dates with slashes of one column: DAY_FIRST, MONTH_FIRST or OPEN."""
    for text in texts:
        match = _TIME.fullmatch(text) or _WHOLE_DATE.fullmatch(text)
        if match is None or not match["first"]:
            continue
        if int(match["first"]) > 12:
            return DAY_FIRST
        if int(match["second_field"]) > 12 or match.groupdict().get("half"):
            return MONTH_FIRST
    return OPEN


def has_open_date(text: str) -> str:
    """The date of a time whose order of day and month is open; "" for other texts."""
    match = _TIME.fullmatch(text)
    if match is None or not match["first"]:
        return ""
    return match[0][match.start("first") : match.end("last")]


def nanoseconds(text: str, of_dates: str = OPEN) -> int:
    """A time of day in ns since 1970, or since midnight without a date. Raises UsageError."""
    match = _TIME.fullmatch(text.strip())
    if match is None:
        raise UsageError(f"{text!r:.40} is not a time of day")
    hour = int(match["hour"] or 0)
    minute = int(match["minute"] or match["only_minute"])
    second = int(match["second"] or match["only_second"] or 0)
    part = (match["part"] or match["ms"] or match["only_part"] or "")[:9]  # what is finer than ns is left out
    try:
        if minute > 59 or second > _LEAP:
            raise ValueError
        if half := (match["half"] or "").lower():
            if not 1 <= hour <= 12:
                raise ValueError
            hour = hour % 12 + 12 * half.startswith("p")
        day = _day(match, of_dates)
    except ValueError:
        raise UsageError(f"{text!r:.40} is not a time of day") from None
    seconds = 3600 * hour + 60 * minute + second
    zone = match["zone"] or ""
    if zone[:1] in ("+", "-"):
        fields = zone[1:].replace(":", "").ljust(4, "0")
        seconds -= int(f"{zone[0]}1") * (3600 * int(fields[:2]) + 60 * int(fields[2:]))
    return day * DAY_NS + seconds * 1_000_000_000 + int(part.ljust(9, "0"))


def _day(match: re.Match[str], of_dates: str) -> int:
    """Days from 1970 to the date; 0 without one. Raises ValueError."""
    if match["year"]:
        fields = match["year"], match["month"], match["day"]
    elif match["compact_year"]:
        fields = match["compact_year"], match["compact_month"], match["compact_day"]
    elif match["y"]:
        fields = match["y"], match["m"], match["d"]
    elif match["named_year"]:
        fields = match["named_year"], str(_MONTHS[match["name"][:3].lower()]), match["named_day"]
    elif match["third_year"]:
        fields = match["third_year"], str(_MONTHS[match["first_name"][:3].lower()]), match["second_day"]
    elif match["first"] and of_dates == DAY_FIRST:
        fields = match["last"], match["second_field"], match["first"]
    elif match["first"]:
        fields = match["last"], match["first"], match["second_field"]
    else:
        return 0
    year, month, day = map(int, fields)
    if year < 100:
        year += 1900 if year >= _CENTURY else 2000
    return date(year, month, day).toordinal() - _1970
