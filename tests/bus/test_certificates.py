"""An authority in memory: its certificates are accepted by TLS for the right names, both ways, and for a long time."""

import re
import socket
import ssl
import threading
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from rig.bus.certificates import Authority, Certificate, is_address
from rig.errors import UsageError


def _context(folder: Path, side: int, authority: Authority, own: Certificate) -> ssl.SSLContext:
    path = folder / f"{side}.pem"
    path.write_text(own.certificate + own.key)
    context = ssl.SSLContext(side)
    context.load_verify_locations(cadata=authority.certificate)
    context.load_cert_chain(path)
    context.verify_mode = ssl.CERT_REQUIRED
    return context


def _meets(folder: Path, listening: Authority, calling: Authority, host: str, asked: str) -> str:
    """The common name that the server sees of a client of `calling`, or why they do not meet."""
    server = _context(folder, ssl.PROTOCOL_TLS_SERVER, listening, listening.server(host, "127.0.0.1"))
    client = _context(folder, ssl.PROTOCOL_TLS_CLIENT, calling, calling.client("nf"))
    near, far = socket.socketpair()
    seen = []

    def serve() -> None:
        with suppress(OSError), server.wrap_socket(far, server_side=True) as secured:
            peer = secured.getpeercert() or {}
            seen.append(dict(row[0] for row in peer["subject"])["commonName"])
            secured.send(b"in")

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        with near, client.wrap_socket(near, server_hostname=asked) as secured:
            secured.recv(2)
    except OSError as fault:
        return str(fault)
    finally:
        thread.join()
    return seen[0]


def test_both_sides_accept_each_other(tmp_path: Path) -> None:
    authority = Authority("rig mine")
    assert _meets(tmp_path, authority, authority, "bench.example", "bench.example") == "nf"
    assert _meets(tmp_path, authority, authority, "bench.example", "127.0.0.1") == "nf"


def test_another_name_and_another_authority_are_refused(tmp_path: Path) -> None:
    authority = Authority("rig mine")
    assert "Hostname mismatch" in _meets(tmp_path, authority, authority, "bench.example", "other.example")
    assert "CERTIFICATE_VERIFY_FAILED" in _meets(tmp_path, authority, Authority("rig mine"), "bench", "bench")


def test_a_certificate_outlasts_the_run() -> None:
    now = datetime.now(UTC)
    short = Authority("rig mine", 60.0)
    assert now - timedelta(hours=25, seconds=2) <= short.begins <= now - timedelta(hours=25) + timedelta(seconds=2)
    assert timedelta(days=7) - timedelta(seconds=2) <= short.ends - now <= timedelta(days=7, seconds=2)
    assert Authority("rig mine", 30 * 86400.0).ends - now > timedelta(days=31) - timedelta(seconds=2)


def test_the_fingerprint_is_that_of_the_certificate() -> None:
    import hashlib

    made = Authority("rig mine").server("::1")
    digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(made.certificate)).hexdigest().upper()
    assert made.fingerprint.replace(":", "") == digest
    assert re.fullmatch(r"([0-9A-F]{2}:){31}[0-9A-F]{2}", made.fingerprint)
    assert is_address("::1")
    assert not is_address("bench.example")


def test_the_certificates_of_the_page_serve_a_cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lines of docs/remote.md; scheduler and workers of dask show one file each, as server and as client."""
    page = (Path(__file__).parents[2] / "docs" / "remote.md").read_text()
    monkeypatch.chdir(tmp_path)
    exec(page.partition("```python\n")[2].partition("```")[0], {})
    server, client = (ssl.SSLContext(side) for side in (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT))
    for context, host in ((server, "192.168.7.2"), (client, "192.168.7.3")):
        own = tmp_path / f"{host}.pem"
        assert own.stat().st_mode & 0o777 == 0o600
        context.load_verify_locations(tmp_path / "ca.pem")
        context.load_cert_chain(own)
        context.verify_mode = ssl.CERT_REQUIRED
    near, far = socket.socketpair()
    thread = threading.Thread(target=lambda: server.wrap_socket(far, server_side=True).close())
    thread.start()
    with near, client.wrap_socket(near, server_hostname="192.168.7.2") as secured:
        assert secured.version() == "TLSv1.3"
    thread.join()


def test_without_the_library_the_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    for name in [name for name in sys.modules if name.partition(".")[0] == "cryptography"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(UsageError, match=r"cryptography.* cannot be loaded .*pip install .*\[remote\]"):
        Authority("rig mine")
