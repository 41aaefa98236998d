"""Faults of what happens to files (rows P).

Most are tried on copies of the task that is loaded, in a folder of their own: what people have saved is
never touched. The refusal that they provoke is what is shown.
"""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path
from typing import BinaryIO

from vita.faults.refusal import read, refused, task, text
from vita.faults.registry import injector
from vita.faults.site import Site
from vita.scenario import disk, toml_io
from vita.scenario.schema import SCHEMA
from vita.scenario.seal import sealed


@injector("P2")
def full_disk(site: Site) -> None:
    """From now on, half of a file fits on the disk."""

    def half(file: BinaryIO, data: bytes) -> None:
        file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before, disk.writer = disk.writer, half

    def back() -> None:
        disk.writer = before

    site.tap.undo["P2"] = back


@injector("P3")
def name_that_leads_out(site: Site) -> None:
    from vita.ui.drawer import Drawer

    with tempfile.TemporaryDirectory() as folder:
        drawer = Drawer(Path(folder) / "tasks")
        refused("save as '../../x'", lambda: drawer.save("../../x", task(site)))


@injector("P4")
def newer_version(site: Site) -> None:
    later = text(site).replace(f"schema = {SCHEMA}", f"schema = {SCHEMA + 2}", 1)
    refused("open a file of a newer vita", read(later))


@injector("P6")
def unknown_key(site: Site) -> None:
    refused("open a file with the key 'sead'", read(f"sead = 1\n{text(site)}"))


@injector("P7")
def damaged(site: Site) -> None:
    """One bit in the middle of a saved file."""
    data = bytearray(sealed(text(site)).encode())
    data[len(data) // 2] ^= 1
    refused("open a file of which one bit was flipped", lambda: toml_io.loads(bytes(data), "the file"))


@injector("P8")
def two_pages(site: Site) -> None:
    from vita.ui.drawer import Drawer

    with tempfile.TemporaryDirectory() as folder:
        drawer = Drawer(Path(folder))
        drawer.save("my task", task(site), "one page")
        refused("save one name from two pages", lambda: drawer.save("my task", task(site), "another page"))
