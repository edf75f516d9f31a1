"""Refuse what does not come from the recorder's own page: other hosts, other origins, too much data."""

from collections.abc import Collection

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SAFE = ("GET", "HEAD")
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class TooLarge(Exception):
    """More data came than a request may carry."""


class Guard:
    """Middleware that lets only the recorder's own page in.

    A foreign Host betrays DNS rebinding, a foreign Origin another site's script. Requests that change something must
    name their origin. Responses forbid everything that is not of this server.
    """

    def __init__(self, app: ASGIApp, hosts: Collection[str]) -> None:
        """Take the app and the values of Host, such as `127.0.0.1:8000`, under which it may be asked."""
        self.app = app
        self.hosts = hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 403, or pass the request on."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        if refusal := self._refusal(scope["method"], Headers(scope=scope)):
            await JSONResponse({"error": refusal}, 403, headers=HEADERS)(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await self.app(scope, receive, send_with_headers)

    def _refusal(self, method: str, headers: Headers) -> str:
        """Return why a request is refused, or an empty string."""
        if headers.get("host") not in self.hosts:
            return "refused: the recorder answers only under the address that it printed"
        origins = {f"http://{host}" for host in self.hosts} | ({None} if method in SAFE else set())
        if headers.get("origin") not in origins:
            return "refused: the request comes from another page than the recorder's"
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            return "refused: the request comes from another site"
        return ""


async def body_of(request: Request, limit: int) -> bytes:
    """Return a request's body; raise TooLarge as soon as it is longer than `limit` bytes."""
    if int(request.headers.get("content-length", "0")) > limit:
        raise TooLarge(f"more than {limit / 1e6:.0f} MB were sent: choose a smaller file")
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > limit:
            raise TooLarge(f"more than {limit / 1e6:.0f} MB were sent: choose a smaller file")
    return bytes(body)
