"""Task files on the disk: written in one stroke, read with suspicion.

A reader sees the old file or the new one, never a part, whenever the power goes: the bytes go to a
temporary file beside the target, are forced to the disk, and take the target's name at once.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from vita.errors import BadInput

MAX_BYTES = 250_000
"""Twice what the largest possible task needs [bytes]."""
STALE_S = 60.0
"""No save takes so long: a temporary file that is older was left behind by a program that was killed [s]."""
_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{8}\.tmp")
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def put(file: BinaryIO, data: bytes) -> None:
    """Write and wait until the disk has it."""
    file.write(data)
    file.flush()
    os.fsync(file.fileno())


writer: Callable[[BinaryIO, bytes], None] = put
"""How bytes get to the disk; the fault page puts a full disk here."""


def replace_file(path: Path, data: bytes) -> None:
    """Give the file new contents, or leave it and raise `BadInput`."""
    target = path.resolve() if path.is_symlink() else path  # replace what a link points at, not the link
    temporary = target.with_name(f".{target.name[:64]}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as file:
            writer(file, data)
        os.replace(temporary, target)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise BadInput(f"not saved: {why(error)}", str(path)) from None
    _settle(target.parent)


def _settle(folder: Path) -> None:
    """Force the new name to the disk as well, where the system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def sweep(folder: Path, older_than_s: float = STALE_S) -> int:
    """Remove what killed programs left behind in a folder; returns how many files that were."""
    swept, now = 0, time.time()
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            with contextlib.suppress(OSError):
                if _TEMPORARY.fullmatch(path.name) and now - path.lstat().st_mtime >= older_than_s:
                    path.unlink()
                    swept += 1
    return swept


def why(error: OSError) -> str:
    """The system's reason in a few words for people."""
    if error.errno in _FULL:
        return "disk full"
    return error.strerror or str(error)


def read(path: Path) -> bytes:
    """The bytes of a file that could be a task; never more than `MAX_BYTES` of anything."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise BadInput(f"cannot read the file: {error.strerror or error}", str(path)) from None
    return data


def decoded(data: bytes, source: str) -> str:
    """Bytes as text, or `BadInput` that says in which line they are none."""
    if len(data) > MAX_BYTES:
        raise BadInput(f"larger than {MAX_BYTES // 1000} kB, which no scenario file is", source)
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise BadInput("line 1: the file is UTF-16; save it as UTF-8", source)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise BadInput(f"line {line}: not a text file in UTF-8", source) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise BadInput(f"line {line}: holds a zero byte, so it is not a text file", source)
    return text
