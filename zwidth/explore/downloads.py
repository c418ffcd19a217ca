"""Downloads from the page: the chosen run as a log, or as a scenario that can be run."""

import asyncio
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import parse_qs

from tornado.web import HTTPError, RequestHandler

from zwidth.explore.bench import Bench
from zwidth.explore.view import read_query
from zwidth.scenarios.logged_run import logged_run
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import scenario_to_text


class Download(RequestHandler):
    """Serves run.mcap and run.toml for the wall in the query; serves no files.

    hosts: names that a request may use; any other name means that a foreign page points at this
    machine.
    """

    def initialize(self, bench: Bench, hosts: frozenset[str]) -> None:
        """Store the objects of the server."""
        self.bench, self.hosts = bench, hosts

    async def get(self, kind: str) -> None:
        """Answer with a file that a browser saves."""
        if self.request.host not in self.hosts:
            raise HTTPError(403, "this server does not answer to this host name")
        try:
            content = await asyncio.to_thread(self._content, kind)
        except ValueError as error:
            self.set_status(400)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(f"{error}\n")
            return
        self.set_header("Content-Type", "application/octet-stream")
        self.set_header("Content-Disposition", f'attachment; filename="run.{kind}"')
        self.set_header("X-Content-Type-Options", "nosniff")
        self.finish(content)

    def _content(self, kind: str) -> bytes:
        scenario = _scenario(self.bench, self.request.query)
        if kind == "toml":
            return scenario_to_text(scenario).encode()
        with TemporaryDirectory(prefix="zwidth-") as folder:
            return logged_run(scenario, Path(folder) / "run.mcap").path.read_bytes()

    def data_received(self, chunk: Any) -> None:
        """Ignore request bodies."""


def _scenario(bench: Bench, query: str) -> Scenario:
    view, complaints = read_query(parse_qs(query, keep_blank_values=True), len(bench.devices))
    if complaints:
        raise ValueError(complaints[0])
    if view.stiffness is None or view.damping is None:
        raise ValueError("the address gives no wall; add K and B")
    return bench.scenario(view)
