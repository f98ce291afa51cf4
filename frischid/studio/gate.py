"""Who may speak to the studio: the browser that was given its address, from the studio's own page, and nobody else.

A web page of any origin may send requests to a server on the reader's own machine. For HTTP its scripts cannot read the
answer, but a WebSocket is open to every page: only the server can refuse. `Gate` refuses every request, of either kind,

1. whose path does not begin with the secret token of the printed address,
2. whose ``Host`` is a name that is not this server's: a foreign name that was made to lead here (DNS rebinding),
3. whose ``Origin``, which a script cannot forge, is not the page that the ``Host`` serves.

A request without an ``Origin`` is no page's script: the reader typed the address, or a program did.
Sources: RFC 6455, section 10.2 (origin of a WebSocket); RFC 6454 (the origin concept).
"""

from __future__ import annotations

import hmac
import http
import ipaddress
import secrets
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import urlsplit

from frischid.core.extras import install_command
from frischid.errors import InputError

TOKEN_BYTES = 16  # 128 random bits cannot be guessed
REFUSAL = "This page opens at the address that the command `frischid studio` printed.\n"
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""No other page may frame this one, and no other server learns its address."""

_REPLACING = threading.Lock()  # over the function of websockets that opens a server


@dataclass(frozen=True)
class Gate:
    """The three conditions of a request.

    Examples
    --------
    >>> from frischid.studio.gate import Gate
    >>> gate = Gate("127.0.0.1", "secret")
    >>> gate.refusal("/secret", ["localhost:8080"], ["http://localhost:8080"])
    >>> gate.refusal("/secret", ["localhost:8080"], ["https://example.org"])
    'Origin'
    >>> gate.refusal("/", ["localhost:8080"], [])
    'token'
    """

    host: str
    """Address that the server listens on."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))
    """First part of every path."""

    def refusal(self, path: str, hosts: list[str], origins: list[str]) -> str | None:
        """Name of the first condition that a request does not fulfil; None for a request that may come in.

        Parameters
        ----------
        path : str
            Path of the request, with its query.
        hosts, origins : list of str
            Values of its headers ``Host`` and ``Origin``.
        """
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return "Host"
        if origins and origins not in ([f"http://{hosts[0]}"], [f"https://{hosts[0]}"]):
            return "Origin"
        given = path.partition("?")[0].split("/")[1:2]
        if not given or not hmac.compare_digest(given[0].encode(), self.token.encode()):
            return "token"
        return None

    def inside(self, path: str) -> str:
        """The path behind the token."""
        return "/" + path.split("/", 2)[2] if path.count("/") > 1 else "/"

    def _is_own(self, host: str) -> bool:
        """Whether a ``Host`` is loopback, an address in numbers, or a name of this machine.

        An address in numbers is one that no foreign name server has chosen.
        """
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:
            return False
        if name is None:
            return False
        if name in ("localhost", self.host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()):
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def guarded(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """A request handler of websockets that answers only to whom the gate lets in.

        Parameters
        ----------
        answer : callable
            Takes the connection and the request; returns a response, or None to go on with a WebSocket.
        """

        def handle(connection: Any, request: Any) -> Any:
            headers = request.headers
            if self.refusal(request.path, headers.get_all("Host"), headers.get_all("Origin")) is not None:
                response = connection.respond(http.HTTPStatus.FORBIDDEN, REFUSAL)
            else:
                response = answer(connection, replace(request, path=self.inside(request.path)))
            if response is not None:
                for name, value in HEADERS.items():
                    response.headers[name] = value
            return response

        return handle

    def opened(self, viser_server: Callable[[], Any]) -> Any:
        """Open viser's server with the gate before it.

        viser has no setting for it: while the server opens, the function of websockets that viser calls gets the
        gate's handler around the one it is given.

        Parameters
        ----------
        viser_server : callable
            Makes the server, and returns once it listens.

        Raises
        ------
        InputError
            This version of viser opens its server in another way; the server is stopped again.
        """
        from websockets.asyncio import server

        real, guarded = server.serve, []

        def serve(*args: Any, **options: Any) -> Any:
            answer: Any = options.get("process_request")
            if getattr(answer, "__module__", "") == "viser.infra._infra":
                guarded.append(True)
                options["process_request"] = self.guarded(answer)
            return real(*args, **options)

        with _REPLACING:
            try:
                vars(server)["serve"] = serve
                opened = viser_server()
            finally:
                vars(server)["serve"] = real
        if not guarded:
            opened.stop()
            raise InputError(
                f"with this version of viser, the studio cannot refuse pages of other sites; update viser: "
                f"{install_command('studio')} --upgrade"
            )
        return opened
