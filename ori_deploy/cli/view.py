"""`ori-deploy view`: a design, a plan or a flight log in the browser."""

from __future__ import annotations

import signal
import threading
import webbrowser
from pathlib import Path

import click

from ori_deploy.cli.frame import IN, console, example
from ori_deploy.cli.viewing import LOOPBACK, moved_on, require_viser


@click.command(epilog=example("ori-deploy view wing.plan.json"))
@click.argument("file", metavar="DESIGN|PLAN|LOG", type=IN)
@click.option("--design", type=IN, help="Design file of a plan or log.  [default: the one beside it]")
@click.option("--port", type=click.IntRange(0, 65535), help="0: any that is free.  [default: 8080, or the next free]")
@click.option("--host", default=LOOPBACK, show_default=True, help="Where to listen.")
@click.option(
    "--beyond-loopback", is_flag=True, help="Let other machines see it, who have its address with the token."
)
@click.option("--browser", is_flag=True, help="Open it in a browser.")
def view(file: Path, design: Path | None, port: int | None, host: str, beyond_loopback: bool, browser: bool) -> None:
    """Show a DESIGN, a PLAN or a flight LOG in the browser, until Ctrl-C.

    The page of a running controller is that of `deploy --view` or `serve --view`.
    """
    require_viser()
    from ori_deploy.page.door import Door
    from ori_deploy.page.listening import listening
    from ori_deploy.page.playing import Player
    from ori_deploy.page.site import serve
    from ori_deploy.page.sources import source_of

    door = Door.on(host, beyond_loopback=beyond_loopback)
    source = source_of(file, design)
    server = serve(door, listening(door.host, port), file.name)
    Player(server, source)
    address = door.address(server.get_port())
    console.print(f"page: {address}", markup=False, soft_wrap=True)
    if (moved := moved_on(port, address)) is not None:
        console.print(moved, markup=False, soft_wrap=True)
    if browser:
        webbrowser.open(address)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    ended.wait()
    server.stop()
