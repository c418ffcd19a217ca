"""The server: by default for this machine only, and only for its own pages."""

import errno
from typing import Any, NamedTuple

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop

from zwidth.explore.bench import Bench
from zwidth.explore.downloads import Download
from zwidth.explore.session import Session
from zwidth.explore.view import read_query

LOCAL = "localhost"
ANY = ("", "0.0.0.0", "::", "*")
GONE_MS = 15_000  # after which a page without a browser is closed
MOST_BYTES = 400 * 2**20  # of a recording that is dropped into the page


class Listening(NamedTuple):
    """A server that has not started yet, and the address of its page."""

    server: BaseServer
    url: str


def listen(bench: Bench, address: str = LOCAL, port: int = 0) -> Listening:
    """Return a listening server; `server.start()` and its `io_loop` start it.

    port 0: any free port. A browser has access by `address` and the port only. Raises ValueError if
    the port is in use or the address does not belong to this machine.
    """
    if address in ANY:
        raise ValueError(
            f"--address {address or repr(address)} is not a usable address; give the host name or"
            " IP address by which others reach this machine"
        )
    try:
        sockets, port = bind_sockets(address, port)
    except OSError as error:
        raise ValueError(_why(error, address, port)) from None
    names = ("localhost", "127.0.0.1", "[::1]") if address == LOCAL else (_host(address),)
    hosts = frozenset(f"{name}:{port}" for name in names)
    application = BokehTornado(
        {"/": Application(FunctionHandler(lambda document: _open(document, bench)))},
        extra_websocket_origins=sorted(hosts),
        extra_patterns=[(r"/run\.(mcap|toml)", Download, {"bench": bench, "hosts": hosts})],
        check_unused_sessions_milliseconds=1000,
        unused_session_lifetime_milliseconds=GONE_MS,
        websocket_max_message_size_bytes=MOST_BYTES,
    )
    http = HTTPServer(application)
    http.add_sockets(sockets)
    server = BaseServer(IOLoop.current(), application, http)
    return Listening(server, f"http://{_host(address)}:{port}/")


def _open(document: Document, bench: Bench) -> None:
    context: Any = document.session_context
    arguments: dict[str, list[bytes]] = context.request.arguments if context else {}
    query = {
        key: [v.decode("utf-8", "replace") for v in values] for key, values in arguments.items()
    }
    view, complaints = read_query(query, len(bench.devices))
    session = Session(document, bench, view, complaints)
    session.page.put_on(document)


def _host(address: str) -> str:
    return f"[{address}]" if ":" in address else address


def _why(error: OSError, address: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} is in use; give another with --port, or 0 for any that is free"
    if error.errno in (errno.EACCES, errno.EPERM):
        return (
            f"port {port} needs rights that you do not have; give a port of 1024 or above with"
            " --port"
        )
    reason = (error.strerror or str(error)).lower()
    return f"--address {address} cannot be listened on ({reason}); give one of this machine's own"
