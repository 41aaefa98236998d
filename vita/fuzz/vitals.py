"""What a process costs, read from `/proc`: memory, threads, handles, children. Linux only."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from vita.errors import MissingDependency

PROC = Path("/proc")


@dataclass(frozen=True)
class Vitals:
    """One process at one moment; zeros when it is gone."""

    memory_mb: float = 0.0
    """What it holds for itself alone [MB]; pictures in shared memory are nobody's own."""
    threads: int = 0
    handles: int = 0
    """Open files, sockets and pipes."""
    cpu_s: float = 0.0
    """Processor time so far [s]."""


def vitals(pid: int) -> Vitals:
    try:
        status = (PROC / str(pid) / "status").read_text()
        stat = (PROC / str(pid) / "stat").read_text()
        handles = len(os.listdir(PROC / str(pid) / "fd"))
    except OSError:
        return Vitals()
    fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    if "RssAnon" not in fields:  # a zombie
        return Vitals()
    ticks = stat.rpartition(")")[2].split()[11:13]
    return Vitals(
        int(fields["RssAnon"].split()[0]) / 1024, int(fields["Threads"]), handles,
        sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK"),
    )  # fmt: skip


def children(pid: int) -> tuple[int, ...]:
    """The processes that a process has started and not yet buried, with their own."""
    found: list[int] = []
    try:
        for task in (PROC / str(pid) / "task").iterdir():
            found += map(int, (task / "children").read_text().split())
    except OSError:
        return tuple(found)
    return tuple(sorted([*found, *(grandchild for child in found for grandchild in children(child))]))


def command(pid: int) -> str:
    """How a process was started; empty when it is gone."""
    try:
        return (PROC / str(pid) / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


def check_proc() -> None:
    if not (PROC / "self" / "status").is_file():
        raise MissingDependency("this needs /proc, which Linux has")
