"""Who may speak to the server: token, host, origin, also of web sockets."""

import socket

import httpx
import pytest
from patience import PATIENCE_S
from websockets.exceptions import InvalidStatus

from rig.errors import UsageError
from rig.web.server import Server


def test_the_token_opens_the_page_and_moves_to_a_cookie(server):
    with httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as http:
        first = http.get(server.address)
        assert first.status_code == 303
        assert first.headers["location"] == "/"
        assert "HttpOnly" in first.headers["set-cookie"]
        assert "SameSite=strict" in first.headers["set-cookie"]
        page = http.get("/")
        assert page.status_code == 200
        assert "frame-ancestors 'none'" in page.headers["content-security-policy"]
        assert http.get("/page/main.js").headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize("path", ["/", "/api/run", "/?token=wrong"])
def test_without_the_token_nothing_is_answered_and_the_remedy_is_told(server, path):
    found = httpx.get(f"http://127.0.0.1:{server.port}{path}")
    assert found.status_code == 403
    assert "Open the address that rig web printed" in found.text


def test_cookies_of_other_servers_on_this_machine_do_not_lock_the_user_out(client):
    own, name = client.cookie, f"bench-{client.server.port}"
    for cookie in (f'a=[1, "2"]; {own}', f"nonsense; {own}", f"{name}=stale; {own}", f"{own}; {name}=stale"):
        assert httpx.get(client.base + "/api/run", headers={"Cookie": cookie}).status_code == 200
    for cookie in (own.replace("bench", "tench"), f"{name}=", own[:-1], own.upper()):
        assert httpx.get(client.base + "/api/run", headers={"Cookie": cookie}).status_code == 403


def test_the_token_is_in_no_output_and_in_no_referer(server, capfd):
    with httpx.Client(base_url=f"http://127.0.0.1:{server.port}", follow_redirects=True) as http:
        page = http.get(server.address)
        http.get("/nowhere?token=" + server.token)
        http.post("/api/run", content=b"{")
    assert page.history[0].headers["referrer-policy"] == page.headers["referrer-policy"] == "no-referrer"
    assert page.headers["cross-origin-resource-policy"] == "same-origin"
    said = capfd.readouterr()
    assert server.token not in page.text + said.out + said.err


def test_another_host_name_or_origin_is_refused_in_spite_of_the_cookie(client):
    good = client.get("/api/scenes")
    assert good.status_code == 200
    for head in (
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": f"http://127.0.0.1:{client.server.port + 1}"},
        {"Origin": "null"},
    ):
        assert client.http.get("/api/scenes", headers=head).status_code == 403
        assert client.http.post("/api/run", json={"scene": "belt"}, headers=head).status_code == 403
    assert client.http.get("/api/scenes", headers={"Origin": client.base}).status_code == 200
    assert client.state()["phase"] == "idle"


@pytest.mark.parametrize(
    ("origin", "cookie"),
    [("http://evil.example", None), (None, ""), (None, "bench-PORT=wrong")],
)
def test_a_web_socket_needs_the_cookie_and_the_origin_of_the_page(client, origin, cookie):
    cookie = cookie and cookie.replace("PORT", str(client.server.port))
    with pytest.raises(InvalidStatus, match="403"):
        client.socket(origin, cookie)
    with client.socket() as good:
        assert '"kind": "state"' in good.recv(PATIENCE_S)


def test_it_listens_on_loopback_only(server):
    assert server.address.startswith(f"http://127.0.0.1:{server.port}/?token=")
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", server.port), 2.0)


def test_a_port_in_use_is_refused_with_the_remedy(server, tmp_path):
    with pytest.raises(UsageError, match=f"--port {server.port}: cannot be used .*choose another one, or leave it out"):
        Server(server.port, tmp_path)
