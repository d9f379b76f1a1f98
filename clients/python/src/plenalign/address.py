"""Where the daemon is, how it is known to be the daemon, and who asks."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import os
import ssl
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from .errors import AddressError

DEFAULT = "http://127.0.0.1:8080"
"""Where a daemon serves that is told nothing else."""


class Address:
    """A daemon's address, what vouches for it, and the token that is shown to it.

    `server` is such as `https://bench.lab:8443`; without one, `PLENALIGN_SERVER` of the environment and then the daemon
    on this machine. `token` is a secret made by `plenalign token create`; without one, `PLENALIGN_TOKEN`.

    With TLS the system's authorities vouch for the daemon; or `ca`, the PEM file that `plenalign tls init` made; or
    `fingerprint`, the SHA-256 of its certificate in hexadecimal, with which nothing else is looked at.

    A token is not sent unencrypted over a network unless `insecure` is set.
    """

    def __init__(
        self,
        server: str | None = None,
        *,
        token: str | None = None,
        ca: str | os.PathLike[str] | None = None,
        fingerprint: str | None = None,
        insecure: bool = False,
    ) -> None:
        given = (server or os.environ.get("PLENALIGN_SERVER") or DEFAULT).strip().rstrip("/")
        try:
            parts = urlsplit(given)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise AddressError(f"{given!r} is not an address such as {DEFAULT}: {error}") from None
        if parts.scheme not in ("http", "https") or not host:
            raise AddressError(f"{given!r} is not an address such as {DEFAULT} or https://bench.lab:8443")
        if parts.username or parts.password or parts.path or parts.query or parts.fragment:
            raise AddressError(f"give {parts.scheme}://{host}{f':{port}' if port else ''} alone, without user or path")
        self.base = given
        """The address without a slash at its end."""
        self.encrypted = parts.scheme == "https"
        """Whether TLS is spoken."""
        self.token = _token(token)
        if self.token and not self.encrypted and not insecure and not _is_loopback(host):
            raise AddressError(
                f"the token would go to {host} for everybody to read: use https://, or insecure=True where the "
                "network may be trusted"
            )
        self.tls = self._tls(ca, fingerprint)

    def __repr__(self) -> str:
        """Without the token."""
        return f"Address({self.base!r})"

    @property
    def headers(self) -> dict[str, str]:
        """What says who asks."""
        return {"authorization": f"Bearer {self.token}"} if self.token else {}

    @property
    def socket(self) -> str:
        """The WebSocket's address."""
        return self.base.replace("http", "ws", 1) + "/api/v1/ws"

    def _tls(self, ca: str | os.PathLike[str] | None, fingerprint: str | None) -> ssl.SSLContext | None:
        if not self.encrypted:
            if ca is not None or fingerprint is not None:
                raise AddressError(f"{self.base} is not encrypted, so nothing can vouch for it: use https://")
            return None
        if ca is not None and fingerprint is not None:
            raise AddressError("give ca or fingerprint, not both")
        if fingerprint is not None:
            return _pinned(fingerprint)
        if ca is None:
            return ssl.create_default_context()
        try:
            return ssl.create_default_context(cafile=Path(ca))
        except OSError as error:
            raise AddressError(f"cannot use {os.fspath(ca)}, which should be PEM certificates: {error}") from None


def _token(given: str | None) -> str | None:
    token = (os.environ.get("PLENALIGN_TOKEN", "") if given is None else given).strip()
    if not token:
        return None
    # What is said of it does not say it.
    if not token.isascii() or not token.isprintable() or " " in token:
        raise AddressError("the token holds what none does; it is plenalign_ and letters and figures")
    return token


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _pinned(fingerprint: str) -> ssl.SSLContext:
    """TLS with the one certificate that has this fingerprint, whoever made it."""
    text = fingerprint.strip().removeprefix("sha256:").replace(":", "").lower()
    try:
        wanted = bytes.fromhex(text)
    except ValueError:
        wanted = b""
    if len(wanted) != 32:
        raise AddressError(
            f"{fingerprint!r} is no SHA-256 fingerprint: 64 hexadecimal figures, as "
            "`openssl x509 -noout -fingerprint -sha256 -in cert.pem` prints them"
        )

    def check(certificate: bytes | None) -> None:
        found = hashlib.sha256(certificate or b"").digest()
        if not hmac.compare_digest(found, wanted):
            raise ssl.SSLCertVerificationError(f"the certificate's fingerprint is {found.hex()}, not {text}")

    class PinnedSocket(ssl.SSLSocket):
        def do_handshake(self, *given: Any, **named: Any) -> None:
            super().do_handshake(*given, **named)
            check(self.getpeercert(binary_form=True))

    class PinnedObject(ssl.SSLObject):
        def do_handshake(self) -> None:
            super().do_handshake()
            check(self.getpeercert(binary_form=True))

    context = ssl.create_default_context()
    # In place of authority and name the fingerprint is checked, before anything is sent.
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    context.sslsocket_class = PinnedSocket
    context.sslobject_class = PinnedObject
    return context
