"""The lessons on the page: listed, as HTML without a link to elsewhere, with their figures, and nothing beside them."""

import re

from rig.lessons import lesson, lessons

FILES = 9


def test_lessons_are_listed_and_shown_with_their_figures(client):
    listed = client.get("/api/lessons").json()
    assert [one["title"] for one in listed] == [one.title for one in lessons()]
    for one in listed:
        shown = client.post("/api/lesson", number=one["number"]).json()["html"]
        assert f"<h1>{one['title']}</h1>" in shown
        assert "<table>" in shown
        assert "<a " not in shown
        assert re.search(
            r"<details><summary><h2>Solutions</h2>\n?</summary>.*</details>\n?<h2>What to try", shown, re.DOTALL
        )
        figures = re.findall(r'<img src="([^"]+)"', shown)
        assert figures
        for address in figures:
            figure = client.get(address)
            assert figure.status_code == 200
            assert figure.content.startswith(b"\x89PNG")


def test_a_lesson_in_german_keeps_its_commands_output_and_figures(client):
    parts = re.compile(r"<(p|li|t[dh]|h\d)[^>]*>(.*?)</\1>", re.DOTALL)
    for one in lessons():
        english, german = (
            client.post("/api/lesson", number=one.number, language=language).json()["html"] for language in ("xx", "de")
        )
        for kept in (r"<pre>.*?</pre>", r"<code>.*?</code>", r'src="[^"]*"'):
            assert re.findall(kept, english, re.DOTALL) == re.findall(kept, german, re.DOTALL)
        pairs = list(zip(parts.findall(english), parts.findall(german), strict=True))
        same = [text for (_, text), (_, other) in pairs if text == other]
        assert [text for text in same if re.search("[a-z]{4}", re.sub("<code>.*?</code>", "", text))] == []
        for (_, text), (_, other) in pairs:  # a number of the text is that of the translation
            assert sorted(re.findall(r"\d+(?:\.\d+)?", text)) == sorted(re.findall(r"\d+(?:\.\d+)?", other)), other


def test_a_command_of_a_lesson_runs_and_no_other(client):
    job = client.job("/api/lesson/run", number=1, command="rig modes belt")
    assert job["code"] == 0
    numbers = {number["quantity"]: (number["value"], number["agrees"]) for number in job["numbers"]}
    assert numbers["growth rate"] == ("3.65529 1/s", True)
    assert all(agrees for _, agrees in numbers.values())
    assert any("3.65529" in line and "3.51094" in line for line in job["lines"])
    for command in ("rig modes", "rig modes belt --force", "ls", "", None, "rig modes belt\n"):
        assert client.post("/api/lesson/run", number=1, command=command).status_code == 422


def test_a_lesson_of_files_runs_in_a_folder_of_its_own(client, folder):
    """A command finds what those before it have written, and the file that the page asks for."""
    lines = [line for line in lesson(FILES).file.read_text().splitlines() if line.startswith("rig ")]
    for line in lines[: 1 + next(place for place, command in enumerate(lesson(FILES).commands) if command.files)]:
        job = client.job("/api/lesson/run", number=FILES, command=line)
        assert all(number["agrees"] for number in job["numbers"]), (line, job["numbers"], job["lines"])
    assert list(folder.iterdir()) == []
