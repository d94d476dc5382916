"""The gallery as a page: every figure with its numbers, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from rig.papers.entry import PAPERS, Result


def page(results: Sequence[Result], machine: str) -> str:
    """Return a page of pictures and tables, for the folder of the pictures."""
    lines = [
        "# Figures of the papers, reproduced",
        "",
        f"Made by `make docs` (`rig reproduce all`), the last of them on {machine}.",
        "",
        "A number agrees when it lies within the bound beside it. *Not reproduced*: it is known to lie outside.",
        "Sources: *paper*, printed there; *reference*, an independent computation of the same equations with the same",
        "parameters; *theory*, a closed form.",
        "",
        "| figure | what | scenes | numbers | agree |",
        "|---|---|---|---|---|",
    ]
    for one in results:
        scenes = ", ".join(f"`{scene}`" for scene in one.entry.scenes)
        lines.append(
            f"| [{one.entry.paper} {one.entry.number}](#{one.entry.name}) | {one.entry.title} | {scenes} "
            f"| {len(one.comparisons)} | {one.counted} |"
        )
    for paper, title in PAPERS.items():
        mine = [one for one in results if one.entry.paper == paper]
        if not mine:
            continue
        lines += ["", f"## {title}"]
        for one in mine:
            lines += [
                "",
                f"### {one.entry.name}",
                "",
                f"{one.entry.number}: {one.entry.title}. {one.entry.note}".strip(),
            ]
            lines += ["", f"![{one.entry.title}]({one.picture.name})", ""]
            lines += [f"The figure as [SVG]({one.picture.with_suffix('.svg').name}).", ""]
            lines += ["| number | ours | expected | source | bound | |", "|---|---|---|---|---|---|"]
            lines += [
                f"| {c.what} | {c.ours:.7g} {c.unit} | {f'{c.expected:.7g} {c.unit}' if c.compared else ''} "
                f"| {c.source} | {c.bound} | {c.result} |"
                for c in one.comparisons
            ]
    return "\n".join(lines) + "\n"
