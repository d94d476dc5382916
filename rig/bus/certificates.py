"""Certificates of a run that other hosts can reach: an authority that exists in memory only, for this run alone.

Both sides of a connection by TLS show a certificate that this authority has signed. Its key is never written: nobody
can sign another certificate, and when the process has ended, no other run accepts one of these.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from rig.extras import needed

# A host whose clock is an hour behind accepts the certificate, and so does one whose time zone is taken for another.
_BEFORE = timedelta(hours=25)
_AFTER = timedelta(days=1)  # from the planned end on: a run that is slow or paused lasts longer
_LEAST = timedelta(days=7)


@dataclass(frozen=True)
class Certificate:
    """A certificate and its private key, both as text in PEM."""

    certificate: str
    key: str
    fingerprint: str
    """SHA-256 of the certificate as browsers show it: 32 bytes in hexadecimal digits with colons."""


def is_address(host: str) -> bool:
    """Whether `host` is an IP address and not a name."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


class Authority:
    """An authority called `name` for a run of `lasts_s` seconds.

    Its certificates are valid from `begins`, 25 hours before now, to `ends`, a day after the end of the run and at
    least a week from now. Raises UsageError without the library of the extra `remote`.
    """

    def __init__(self, name: str, lasts_s: float = 0.0) -> None:
        self._x509 = x509 = needed("cryptography.x509", "remote")
        self._curves = needed("cryptography.hazmat.primitives.asymmetric.ec", "remote")
        self._hashes = needed("cryptography.hazmat.primitives.hashes", "remote")
        self._forms = needed("cryptography.hazmat.primitives.serialization", "remote")
        now = datetime.now(UTC).replace(microsecond=0)
        self.begins = now - _BEFORE
        self.ends = now + max(timedelta(seconds=lasts_s) + _AFTER, _LEAST)
        self._name = self._called(name)
        self._key = self._new_key()
        limits = x509.BasicConstraints(ca=True, path_length=0)
        usage = x509.KeyUsage(False, False, False, False, False, True, True, False, False)  # it signs, and nothing else
        self.certificate = self._signed(self._name, self._key, [limits, usage]).certificate
        """The certificate of the authority in PEM. Who trusts it trusts every certificate that the authority signs."""

    def server(self, *hosts: str) -> Certificate:
        """A certificate for a process that listens at `hosts`, names or IP addresses, and may connect to others."""
        x509 = self._x509
        names = [
            x509.IPAddress(ipaddress.ip_address(host)) if is_address(host) else x509.DNSName(host) for host in hosts
        ]
        use = x509.ExtendedKeyUsageOID
        return self._leaf(hosts[0], [use.SERVER_AUTH, use.CLIENT_AUTH], [x509.SubjectAlternativeName(names)])

    def client(self, user: str) -> Certificate:
        """A certificate for the process of `user`, which is its common name. It can connect, but not listen."""
        return self._leaf(user, [self._x509.ExtendedKeyUsageOID.CLIENT_AUTH])

    def _leaf(self, name: str, uses: list[Any], more: Iterable[Any] = ()) -> Certificate:
        x509 = self._x509
        limits = x509.BasicConstraints(ca=False, path_length=None)
        return self._signed(self._called(name), self._new_key(), [limits, x509.ExtendedKeyUsage(uses), *more])

    def _called(self, name: str) -> Any:
        x509 = self._x509
        return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name[:64])])  # the standard allows no more

    def _new_key(self) -> Any:
        return self._curves.generate_private_key(self._curves.SECP256R1())

    def _signed(self, subject: Any, key: Any, extensions: Iterable[Any]) -> Certificate:
        x509 = self._x509
        made = x509.CertificateBuilder(self._name, subject, key.public_key(), x509.random_serial_number())
        made = made.not_valid_before(self.begins).not_valid_after(self.ends)
        for extension in extensions:
            made = made.add_extension(extension, critical=isinstance(extension, (x509.BasicConstraints, x509.KeyUsage)))
        signed = made.sign(self._key, self._hashes.SHA256())
        pem = self._forms.Encoding.PEM
        secret = key.private_bytes(pem, self._forms.PrivateFormat.PKCS8, self._forms.NoEncryption())
        fingerprint = signed.fingerprint(self._hashes.SHA256()).hex(":").upper()
        return Certificate(signed.public_bytes(pem).decode(), secret.decode(), fingerprint)
