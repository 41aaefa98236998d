"""Where the mouse rests, and keys that must not turn the view: a few lines that run in the browser.

viser 1.1 reports clicks and drags, but neither hovering nor a way to keep the arrow keys from its
camera. The script below does these two things and no more. It writes the pointer's place to the
browser's local storage, which the stream reads anyway with every picture to keep its pace. Where
scripts are refused the page still works: the loupe then comes with a drag only, and the view is
put straight again after an arrow key.
"""

from __future__ import annotations

import json
import math

import viser
from viser import _messages

PREFIX = "viser-user:"
"""What viser puts before the keys of `client.local_storage`."""

_SCRIPT = """
const page = (window.vitaPage ||= {});
page.key = KEY;
page.still = true;
if (!page.ready) {
  page.ready = true;
  let last = "";
  const tell = (text) => {
    if (text === last) return;
    last = text;
    try { localStorage.setItem(page.key, text); } catch (refused) {}
  };
  const forget = () => tell("");
  window.addEventListener("pointermove", (event) => {
    const canvas = event.target;
    if (canvas.tagName !== "CANVAS" || canvas.closest(".uplot")) return forget();
    const box = canvas.getBoundingClientRect();
    const x = (event.clientX - box.left + 0.5) / box.width;
    const y = (event.clientY - box.top + 0.5) / box.height;
    tell(x.toFixed(5) + " " + y.toFixed(5));
  }, true);
  document.documentElement.addEventListener("pointerleave", forget);
  window.addEventListener("blur", forget);
  window.addEventListener("pagehide", () => {
    try { localStorage.removeItem(page.key); } catch (refused) {}
  });
  const widget = "[role=slider],[role=tab],[role=radio],[role=option],[role=combobox],[role=listbox]";
  document.body.addEventListener("keydown", (event) => {
    if (!event.key.startsWith("Arrow")) return;
    if (event.target.closest(widget)) event.stopPropagation();
    else if (page.still) Object.defineProperty(event, "code", { value: "" });
  });
}
"""
# On the body, these keys have passed the page's own widgets but have not yet reached viser's camera,
# which goes by `code`, nor the hotkeys, which go by `key`.


def key_of(client: viser.ClientHandle) -> str:
    """Where this client's script writes; two windows of one browser share the storage."""
    return f"vita-pointer-{client.client_id}"


def install(client: viser.ClientHandle) -> None:
    """Have the browser tell where its pointer is, and keep the arrow keys from the camera."""
    _run(client, _SCRIPT.replace("KEY", json.dumps(PREFIX + key_of(client))))


def hold_still(client: viser.ClientHandle, still: bool) -> None:
    """Whether the arrow keys leave the camera alone: yes over the pictures, no in the 3D world."""
    _run(client, f"(window.vitaPage ||= {{}}).still = {json.dumps(still)};")


def place_of(text: str | None) -> tuple[float, float] | None:
    """The place of the window (0 to 1 each) that a script wrote; None away from the pictures."""
    try:
        x, y = (float(part) for part in (text or "").split())
    except ValueError:
        return None
    inside = math.isfinite(x) and math.isfinite(y) and 0.0 <= x <= 1.0 and 0.0 <= y <= 1.0
    return (x, y) if inside else None


def _run(client: viser.ClientHandle, source: str) -> None:
    client._websock_connection.queue_message(_messages.RunJavascriptMessage(source))
