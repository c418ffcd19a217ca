"""`zwidth mcp`: commands as tools for agents."""

import click

from zwidth.heartbeat import HEART


@click.command("mcp")
def command() -> int:
    """Serve diagnose, check, plan and boundary to agents, by the Model Context Protocol.

    A client starts this command and talks to it on standard input and output. It needs the SDK of
    the protocol: pip install 'zwidth[mcp]'.
    """
    try:
        from zwidth.agent_tools import serve
    except ImportError as error:
        raise click.ClickException(
            f"the SDK of the protocol is missing ({error}); run: pip install 'zwidth[mcp]'"
        ) from None
    HEART.stop()  # now it only waits for its client
    return serve()
