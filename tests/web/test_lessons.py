"""The lessons on the page: listed, as HTML without a link to elsewhere, with their figures, and nothing beside them."""

import re

from rig.lessons import lessons


def test_lessons_are_listed_and_shown_with_their_figures(client):
    listed = client.get("/api/lessons").json()
    assert [one["title"] for one in listed] == [one.title for one in lessons()]
    for one in listed:
        shown = client.post("/api/lesson", number=one["number"]).json()["html"]
        assert f"<h1>{one['title']}</h1>" in shown
        assert "<table>" in shown
        assert "<a " not in shown
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
    assert any("3.65529" in line and "3.51094" in line for line in job["lines"])
    for command in ("rig modes", "rig modes belt --force", "ls", "", None, "rig modes belt\n"):
        assert client.post("/api/lesson/run", number=1, command=command).status_code == 422


def test_what_is_no_lesson_is_refused(client):
    for number in (99, -1, "1", None, 1.0, [1]):
        assert client.post("/api/lesson", number=number).status_code == 422
    for name in ("index.md", "..%2Fpage.py", "nothing.png"):
        assert client.get(f"/lessons/{name}").status_code in (404, 422)
