"""The page that browsers get: viser's own, with our bar on it where there is something to command."""

from __future__ import annotations

import socket
from html import escape
from importlib.resources import files
from pathlib import Path

import viser

from ori_deploy.page.channel import Channel
from ori_deploy.page.door import Door, open_server

PLAIN_JS = """<script>
(() => {
  const probe = document.createElement("canvas").getContext("webgl2");
  const told = probe && probe.getExtension("WEBGL_debug_renderer_info");
  const drawer = told ? probe.getParameter(told.UNMASKED_RENDERER_WEBGL) : "";
  if (probe) probe.getExtension("WEBGL_lose_context")?.loseContext();
  if (!/swiftshader|llvmpipe|software/i.test(drawer)) return;
  const get = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, how) {
    return get.call(this, kind, /^webgl/.test(kind) ? { ...how, antialias: false } : how);
  };
  const url = new URL(location.href);
  if (url.searchParams.has("fixedDpr")) return;
  url.searchParams.set("fixedDpr", "0.5");
  history.replaceState(null, "", url);
})();
</script>
"""
"""Where a processor draws, pixels are coarser, and drawn once instead of four times."""

PHONE_CSS = """<style>
  @media (max-width: 576px) { [style*="width: 20em"] { width: 100% !important; } }
</style>
"""
"""viser's panel is narrower than a phone, and hangs in a corner."""


def page_bytes(title: str, *, live: bool) -> bytes:
    """The page's HTML."""
    built = Path(viser.__file__).parent / "client" / "build" / "index.html"
    text = built.read_text(encoding="utf-8")
    text = text.replace("<title>Viser</title>", f"<title>{escape(title)}</title>", 1)
    text = text.replace("</title>", f"</title>{PLAIN_JS}", 1)
    ours = [PHONE_CSS]
    if live:
        ours.append((files("ori_deploy.page") / "static" / "bar.html").read_text(encoding="utf-8"))
    head, end, tail = text.rpartition("</body>")
    return (head + "".join(ours) + end + tail).encode()


def serve(door: Door, ear: socket.socket, title: str, channel: Channel | None = None) -> viser.ViserServer:
    """A server for a page, its looks set, nothing on it yet; `ear` is what `listening` made."""
    server = open_server(door, ear, page_bytes(title, live=channel is not None), channel)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
    server.gui.set_panel_label(title)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(330)
    server.scene.configure_environment_map(hdri=None)  # costs three quarters of a frame without a graphics card
    server.scene.world_axes.visible = False
    return server
