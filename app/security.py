"""The gate before every request and every socket: host, origin, token, clean path, security headers.

It judges the connection scope, so HTTP and websockets go through the same checks, and it lets nothing but
`/healthz` pass without a session. Three attacks decide its shape:

- a foreign page in the same browser: its Origin differs from the Host, on sockets too, where no browser
  leaves it out;
- DNS rebinding: the attacker's name resolves to this machine, so the Host must be a name we know. Bound to
  all addresses, IP literals are let in as well: a name can be rebound, a literal cannot;
- paths that mean one thing here and another to the router: nothing is granted by a path but the one exact
  `/healthz`, and paths that are not in plain form are not found.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
import socket
from dataclasses import dataclass
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app import sign_in

OPEN_PATH = "/healthz"
HOST_HEADER = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::([0-9]{1,5}))?")
WILDCARDS = ("0.0.0.0", "::", "")
DEFAULT_PORTS = {"http": 80, "https": 443}

PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self'; frame-src 'self'; frame-ancestors 'self'; base-uri 'none'; "
    "form-action 'self'; object-src 'none'"
)
SECURITY_HEADERS = {
    "content-security-policy": PAGE_POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "SAMEORIGIN",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


@dataclass(frozen=True)
class Hosts:
    """Which Host headers are ours."""

    names: frozenset[str]
    any_address: bool

    @classmethod
    def of(cls, bound: str, further: tuple[str, ...] = ()) -> Hosts:
        """Loopback, the bound host and further names; all addresses and the machine's own name where the
        server is bound to all of them."""
        everywhere = bound.strip("[]") in WILDCARDS
        names = {"localhost", "127.0.0.1", "::1", *(_plain_name(name) for name in further)}
        if everywhere:
            machine = socket.gethostname().lower()
            names |= {machine, f"{machine}.local"}
        else:
            names.add(_plain_name(bound))
        return cls(frozenset(names), everywhere)

    def allow(self, header: str) -> bool:
        match = HOST_HEADER.fullmatch(header)
        if match is None:
            return False
        name = _plain_name(match[1])
        return name in self.names or (self.any_address and _is_address(name))


def _plain_name(host: str) -> str:
    """Without brackets, lower case; an IPv6 address in its shortest form."""
    name = host.strip("[]").lower()
    return str(ipaddress.ip_address(name)) if _is_address(name) else name


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def same_origin(origin: str, host: str) -> bool:
    """Whether an Origin header names the place that the Host header names."""
    try:
        there = urlsplit(origin)
        here = urlsplit(f"//{host}")
        default = DEFAULT_PORTS.get(there.scheme)
        if default is None or not there.hostname or there.path or there.query or "@" in there.netloc:
            return False
        same_name = _plain_name(there.hostname) == _plain_name(here.hostname or "")
        return same_name and (there.port or default) == (here.port or default)
    except ValueError:
        return False


def is_plain(path: str) -> bool:
    """Whether a decoded path is in the one form that the router and we read alike."""
    return path.startswith("/") and not (
        re.search(r"//|\\|[\x00-\x1f\x7f]", path) or any(part in (".", "..") for part in path.split("/"))
    )


@dataclass(frozen=True)
class Refusal:
    status: int
    detail: str


class Gate:
    """ASGI middleware; see the module's docstring."""

    def __init__(self, app: ASGIApp, token: str, hosts: Hosts) -> None:
        self.app = app
        self.hosts = hosts
        self._token = token.encode()
        self._session = hmac.new(self._token, b"covernav studio session", hashlib.sha256).hexdigest().encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        answer = self._answer(scope)
        if answer is None:
            await self.app(scope, receive, _with_headers(send))
        elif scope["type"] == "http":
            await answer(scope, receive, _with_headers(send))
        elif "websocket.http.response" in scope.get("extensions", {}):
            await answer(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})

    def _answer(self, scope: Scope) -> Response | None:
        """What to say instead of passing the request on; None where it may pass."""
        headers = Headers(scope=scope)
        refusal = self._foreign(headers)
        if refusal is not None:
            return _as_json(refusal)
        if scope["path"] == OPEN_PATH and scope["type"] == "http":
            return None
        token = self._token_in_query(scope)
        if token is not None and self._is_token(token.encode("utf-8", "replace")) and is_plain(scope["path"]):
            return self._sign_in(scope, headers)
        if not self._knows(headers):
            return self._unauthorised(scope, headers, tried=token is not None)
        if not is_plain(scope["path"]):
            return _as_json(Refusal(404, "there is nothing at this address"))
        return None

    def _foreign(self, headers: Headers) -> Refusal | None:
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or not self.hosts.allow(hosts[0]):
            return Refusal(
                403, "this server is not known by that host name; COVERNAV_HOSTS may name it at the start"
            )
        if not all(same_origin(origin, hosts[0]) for origin in origins):
            return Refusal(403, "requests from pages of another origin are refused")
        return None

    def _knows(self, headers: Headers) -> bool:
        scheme, _, credentials = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self._is_token(credentials.strip().encode("latin-1", "replace")):
            return True
        name = _cookie_name(headers["host"])
        return any(
            hmac.compare_digest(value.encode("latin-1", "replace"), self._session)
            for key, value in _cookies(headers)
            if key == name
        )

    def _is_token(self, candidate: bytes) -> bool:
        return hmac.compare_digest(candidate, self._token)

    def _token_in_query(self, scope: Scope) -> str | None:
        if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD"):
            return None
        return dict(_query(scope)).get("token")

    def _sign_in(self, scope: Scope, headers: Headers) -> Response:
        rest = urlencode([(key, value) for key, value in _query(scope) if key != "token"])
        location = quote(scope["path"], safe="/") + (f"?{rest}" if rest else "")
        response = RedirectResponse(location, 303)
        response.set_cookie(
            _cookie_name(headers["host"]), self._session.decode(), httponly=True, samesite="strict", path="/"
        )
        return response

    def _unauthorised(self, scope: Scope, headers: Headers, tried: bool) -> Response:
        asks_for_page = scope["type"] == "http" and "text/html" in headers.get("accept", "")
        if asks_for_page and scope["method"] in ("GET", "HEAD"):
            return HTMLResponse(sign_in.page(tried), 401)
        detail = "the token is missing or wrong: send it as 'Authorization: Bearer TOKEN'"
        response = _as_json(Refusal(401, detail))
        response.headers["www-authenticate"] = "Bearer"
        return response


def _as_json(refusal: Refusal) -> Response:
    return JSONResponse({"detail": refusal.detail}, refusal.status)


def _cookie_name(host: str) -> str:
    """One for each port that a browser sees: cookies know no ports, and two studios may share a machine."""
    match = HOST_HEADER.fullmatch(host)
    return f"covernav_{(match and match[2]) or 'session'}"


def _cookies(headers: Headers) -> list[tuple[str, str]]:
    pairs = (pair.partition("=") for line in headers.getlist("cookie") for pair in line.split(";"))
    return [(name.strip(), value.strip()) for name, _, value in pairs]


def _query(scope: Scope) -> list[tuple[str, str]]:
    try:
        return parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True, max_num_fields=100)
    except ValueError:  # more fields than any of our pages takes
        return []


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in SECURITY_HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return send_with_headers
