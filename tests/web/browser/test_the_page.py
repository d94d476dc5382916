"""Who gets the page, and how it looks and works: languages, the keyboard alone, names and contrast."""

import http.server
import threading

import pytest

pytestmark = pytest.mark.browser
Keys = pytest.importorskip("selenium.webdriver.common.keys", reason="needs Selenium: make install").Keys
ELSEWHERE = """<script>
const told = (text) => { document.title += text + ";"; };
const how = { method: "POST", mode: "no-cors", credentials: "include", body: '{"scene": "belt"}' };
fetch("http://127.0.0.1:PORT/api/run", how)
  .then(() => told("sent"), () => told("unsent"));
fetch("http://127.0.0.1:PORT/api/scenes", { credentials: "include" }).then(() => told("read"), () => told("unread"));
const socket = new WebSocket("ws://127.0.0.1:PORT/live");
socket.onopen = () => told("open");
socket.onclose = () => told("closed");
</script><iframe src="http://127.0.0.1:PORT/"></iframe>"""


@pytest.fixture
def elsewhere(server):
    """The address of another server on this machine, whose page tries to use the bench."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("content-type", "text/html")
            self.end_headers()
            self.wfile.write(ELSEWHERE.replace("PORT", str(server.port)).encode())

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as other:
        thread = threading.Thread(target=other.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{other.server_port}/"
        other.shutdown()
        thread.join(5.0)


def test_a_wrong_token_is_refused_and_the_remedy_told(browser, server):
    browser.get(f"http://127.0.0.1:{server.port}/?token=wrong")
    assert "Open the address that rig web printed" in browser.page_source
    browser.get(server.address)
    assert browser.current_url == f"http://127.0.0.1:{server.port}/"  # no token in the history or a bookmark
    assert browser.execute_script("return document.cookie") == ""


def test_the_page_of_another_server_can_neither_start_a_run_nor_read(page, tab, elsewhere, server):
    other = tab(elsewhere)
    other.until(lambda: other.driver.title.count(";") == 3)
    assert sorted(other.driver.title.strip(";").split(";")) == ["closed", "unread", "unsent"]
    assert server.bench.control.state["phase"] == "idle"
    other.driver.get("about:blank")
    other.complaints()  # of the frame, the request and the socket that were refused


@pytest.mark.parametrize("language", ["de-DE", "en-GB"])
def test_numbers_have_the_decimal_sign_of_the_language_and_are_read_with_either(in_language, language):
    page = in_language(language)
    assert page.run("return navigator.language") == language
    written = ".".join if language == "en-GB" else ",".join
    page.choose("belt_normal_force")
    page.unfold()
    assert page.value("value-drive.speed") == written(["0", "06"])
    page.write("value-load.force", "-3")
    page.until(lambda: page.text("fault-load.force"))
    assert ("muss mindestens 0 N sein" if language == "de-DE" else "must be at least 0 N") in page.text(
        "fault-load.force"
    )
    page.write("value-load.force", "20 N")
    page.write("value-drive.speed", written(["0", "07"]))
    page.until(lambda: page.value("value-drive.speed") == written(["0", "07"]))
    page.write("duration", "0,5")
    page.press("start")
    page.until_phase("ended" if language == "en-GB" else "beendet")
    assert page.value("value-drive.speed") == written(["0", "07"])


def test_the_keyboard_is_enough(page):
    from selenium.webdriver import ActionChains

    def active():
        return page.run("return document.activeElement.id")

    def to(name, most=200):
        for _ in range(most):
            if active() == name:
                return page.driver.switch_to.active_element
            ActionChains(page.driver).send_keys(Keys.TAB).perform()
        raise AssertionError(f"{name} cannot be reached; now at {active()}")

    page.go("bench")
    page.until(lambda: page.text("title"))
    page.driver.find_element("tag name", "body").click()
    to("scene").send_keys("belt –")
    page.until(lambda: page.value("scene") == "belt")
    page.until(lambda: "belt" in page.text("title").lower() and page.one("start").is_enabled())
    to("duration").send_keys("300")
    to("start").send_keys(Keys.ENTER)
    page.until_phase("running")
    page.one("slider-drive.speed")
    to("slider-drive.speed").send_keys(Keys.PAGE_UP)
    page.until(lambda: float(page.value("value-drive.speed")) > 0.06)
    outline = page.run("return getComputedStyle(document.activeElement).outlineStyle")
    assert outline not in ("none", "")
    page.run("document.activeElement.blur()")
    to("stop").send_keys(Keys.SPACE)
    page.until_phase("ended")


NAMED = {"button", "textbox", "slider", "combobox", "checkbox", "link", "DisclosureTriangle", "image", "progressbar"}


def test_every_control_has_a_name_for_screen_readers(page):
    page.choose("belt_normal_force")
    page.unfold()
    page.press("start")
    page.until_phase("running")
    page.until(lambda: page.value("value-drive.speed"))
    nodes = page.tools("Accessibility.getFullAXTree")["nodes"]
    found = [one for one in nodes if not one["ignored"] and one["role"]["value"] in NAMED]
    assert len(found) > 60
    assert [one for one in found if not one.get("name", {}).get("value", "").strip()] == []
    assert {one["role"]["value"] for one in nodes} >= {"banner", "main", "alert", "status", "heading"} - {"alert"}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_stand_out_from_what_is_behind_them(page, scheme):
    """At least 4.5 to 1, as WCAG 2 asks for: every colour of the page for texts on every colour behind them."""
    page.tools("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    found = page.run("""
        const style = getComputedStyle(document.documentElement), probe = document.createElement("i");
        document.body.append(probe);
        const bright = (name) => {
          probe.style.color = style.getPropertyValue("--" + name);
          const parts = getComputedStyle(probe).color.match(/[\\d.]+/g).slice(0, 3).map((one) => one / 255)
            .map((one) => (one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4));
          return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
        };
        const texts = ["text", "soft", "curve", "good", "doubtful", "bad"], behind = ["page", "card"];
        const all = texts.flatMap((one) => behind.map((other) => {
          const [low, high] = [bright(one), bright(other)].sort((a, b) => a - b);
          return [one + " on " + other, (high + 0.05) / (low + 0.05)];
        }));
        probe.remove();
        return Object.fromEntries(all);""")
    assert {name: ratio for name, ratio in found.items() if ratio < 4.5} == {}
    page.picture(f"scheme-{scheme}")
    page.tools("Emulation.setEmulatedMedia", features=[])
