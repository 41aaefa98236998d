"""Files: nothing half-written, nothing damaged, nothing hostile, and nobody's work written over."""

from __future__ import annotations

import dataclasses
import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from bench import Bench, row, task

import vita
from vita import commands as cmd
from vita.errors import BadInput
from vita.faults import CATALOGUE
from vita.fuzz import files
from vita.scenario import disk, migrate
from vita.scenario.schema import ConstraintSpec, Scenario, TrackerSpec
from vita.scenario.seal import sealed
from vita.scenario.toml_io import dumps, load, loads, save
from vita.ui.drawer import Drawer
from vita.ui.ownership import Lease

OLD_FILES = sorted((Path(__file__).parent.parent / "old_files").glob("schema_*.toml"))


@pytest.fixture(scope="module")
def moving() -> Iterator[Bench]:
    """A bench whose arm moves; a refusal must not disturb it."""
    made = Bench()
    made.start()
    yield made
    made.close()


def refused(bench: Bench, name: str) -> str:
    """Press the row's button while the arm moves: what is said. The task, the arm's state and every other
    fault are as before."""
    before = bench.engine.snapshot()
    with pytest.raises(BadInput) as caught:
        bench.inject(name)
    after = bench.tick()
    assert after.status == before.status and after.scenario == before.scenario
    assert after.injected == before.injected and CATALOGUE[name].verdict == "refused"
    return str(caught.value)


# P1 ----------------------------------------------------------------------------------------------

SAVER = """
import os, random, signal, sys, time
from pathlib import Path
from vita.scenario.disk import replace_file
folder = Path(sys.argv[1])
path = folder / "my task.toml"
files = [(folder / name).read_bytes() for name in ("one", "another")]
replace_file(path, files[0])
chance, met = random.Random(7), [0, 0]
for kill in range(200):
    child = os.fork()
    if child == 0:
        while True:  # What a save does once it has its text, so that nearly every kill meets the disk.
            for data in files:
                replace_file(path, data)
    time.sleep(chance.uniform(0.002, 0.006))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    met[files.index(path.read_bytes())] += 1
print(*met, len(list(folder.iterdir())) - 3)
"""


@row("P1")
def test_two_hundred_kills_while_saving_leave_the_old_file_or_the_new_one() -> None:
    memory = Path("/dev/shm")  # where there is one: a kill asks nothing of the disk, and disks are slow
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        kill_savers(Path(folder))


def kill_savers(folder: Path) -> None:
    for name, words in (("one", ""), ("another", "longer " * 500)):
        save(dataclasses.replace(task(), description=words), folder / name)
    root = str(Path(vita.__file__).parent.parent)
    done = subprocess.run(
        [sys.executable, "-c", SAVER, str(folder)],
        capture_output=True, text=True, env=os.environ | {"PYTHONPATH": root},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    one, another, left = map(int, done.stdout.split())
    assert one + another == 200 and min(one, another) >= 10, "hardly any save came to its end"
    assert left >= 20, "hardly any kill met a save, so nothing was shown"
    assert load(folder / "my task.toml").title == "bench"
    assert disk.sweep(folder, older_than_s=3600.0) == 0, "another program may be saving just now"
    assert disk.sweep(folder, older_than_s=0.0) == left


@row("P1")
def test_what_a_kill_left_behind_is_swept_at_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("a.toml.0123abcd", "b.toml.0123abcd", "notes")
    stale, fresh, foreign = (tmp_path / f".{name}.tmp" for name in names)
    for path in (stale, fresh, foreign):
        path.write_text("half")
    for path in (stale, foreign):
        os.utime(path, (0, 0))
    monkeypatch.setenv("VITA_DATA", str(tmp_path))
    Drawer.default()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([fresh.name, foreign.name])


# P2 ----------------------------------------------------------------------------------------------


@contextmanager
def small_disk(most: int) -> Iterator[None]:
    """No file may grow beyond `most` bytes: the system itself refuses the write, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def a_guest(folder: Path) -> Iterator[None]:
    """Somebody who may only read here."""
    folder.chmod(0o555)
    me = os.geteuid()
    if me == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        if me == 0:
            os.seteuid(me)
        folder.chmod(0o755)


@row("P2")
def test_a_full_disk_is_said_and_the_old_file_stays(tmp_path: Path) -> None:
    drawer = Drawer(tmp_path)
    drawer.save("my task", task())
    old = (tmp_path / "my task.toml").read_bytes()
    with small_disk(200), pytest.raises(BadInput, match=r"my task\.toml: not saved: disk full"):
        drawer.save("my task", dataclasses.replace(task(), title="new"))
    assert (tmp_path / "my task.toml").read_bytes() == old and os.listdir(tmp_path) == ["my task.toml"]
    drawer.save("my task", dataclasses.replace(task(), title="new"))
    assert drawer.load("my task").title == "new"


@row("P2")
def test_a_folder_that_is_read_only_is_said_and_the_old_file_stays() -> None:
    with tempfile.TemporaryDirectory() as name:  # where a guest can look in
        drawer, path = Drawer(Path(name)), Path(name) / "my task.toml"
        drawer.save("my task", task())
        old = path.read_bytes()
        words = r"my task\.toml: not saved: Permission denied"
        with a_guest(drawer.folder), pytest.raises(BadInput, match=words):
            drawer.save("my task", dataclasses.replace(task(), title="new"))
        assert path.read_bytes() == old and os.listdir(name) == ["my task.toml"]


@row("P2")
def test_the_button_fills_the_disk_until_it_is_mended(moving: Bench, tmp_path: Path) -> None:
    before = moving.engine.present()
    moving.inject("P2")
    with pytest.raises(BadInput, match="not saved: disk full"):
        save(before, tmp_path / "x.toml")
    assert moving.tick().injected == ("P2",) and moving.engine.present() == before
    moving.engine.apply(cmd.Mend())
    save(before, tmp_path / "x.toml")
    assert load(tmp_path / "x.toml") == before


# P3 ----------------------------------------------------------------------------------------------

BAD_NAMES = [
    "../x", "..", "/etc/passwd", "C:\\x", "CON", "con", "lpt1", "a" * 300, "a\0b", "", ".hidden", "a/b",
    "-rf", "a\nb", "a.toml", "ä", "x" * 64, "\u202egnp", "٣",
]  # fmt: skip


@row("P3")
@pytest.mark.parametrize("name", BAD_NAMES, ids=repr)
def test_a_name_cannot_lead_out_of_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(BadInput, match="use 1 to 63 letters, digits, spaces, - and _"):
        Drawer(tmp_path / "tasks").save(name, Scenario())
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@row("P3")
def test_a_link_is_not_followed_out_of_the_folder(tmp_path: Path) -> None:
    drawer, outside = Drawer(tmp_path / "tasks"), tmp_path / "outside.toml"
    drawer.folder.mkdir()
    outside.write_text(dumps(Scenario(title="mine")))
    (drawer.folder / "link.toml").symlink_to(outside)
    before = outside.read_bytes()
    for attempt in (lambda: drawer.save("link", Scenario()), lambda: drawer.load("link")):
        with pytest.raises(BadInput, match="link: is a link to somewhere else"):
            attempt()
    assert outside.read_bytes() == before


@row("P3")
def test_the_button_shows_the_refusal_of_a_name(moving: Bench) -> None:
    assert "use 1 to 63 letters" in refused(moving, "P3")


# P4 and P5 ---------------------------------------------------------------------------------------


@row("P4")
def test_a_file_of_a_newer_version_is_refused_and_not_written_over(tmp_path: Path, moving: Bench) -> None:
    path = tmp_path / "later.toml"
    path.write_text('schema = 3\nholograms = [1, 2]\n[scene]\nrobot = "wam7"\n')
    before = path.read_bytes()
    words = "made by version 3 of the format; this is 1: install a newer vita"
    with pytest.raises(BadInput, match=words):
        load(path)
    with pytest.raises(BadInput, match=f"not saved: the file there was {words}"):
        save(Scenario(), path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["later.toml"]
    assert words in refused(moving, "P4")


@row("P5")
@pytest.mark.parametrize("path", OLD_FILES, ids=lambda path: path.stem)
def test_files_of_every_version_so_far_still_open(path: Path) -> None:
    """One file of each version is kept for ever."""
    scenario = load(path)
    assert scenario.title.startswith("Every table of schema") and len(scenario.tracker) >= 3
    assert loads(dumps(scenario)) == scenario
    assert {int(p.stem.partition("_")[2]) for p in OLD_FILES} == set(range(1, scenario.schema + 1))


@row("P5")
def test_an_older_file_is_upgraded_and_kept_beside_at_the_first_save(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Schema 1 is the first one, so the older one is made up: it called the title `name`."""
    old = 'schema = 0\nname = "from long ago"\n[scene]\nrobot = "wam4"\n'
    (tmp_path / "mine.toml").write_text(old)
    drawer = Drawer(tmp_path)
    with pytest.raises(BadInput, match="there is no schema 0"):
        drawer.load("mine")
    monkeypatch.setitem(
        migrate.MIGRATIONS, 0, lambda t: {"title" if k == "name" else k: v for k, v in t.items()}
    )
    scenario = drawer.load("mine")
    assert (scenario.title, scenario.schema) == ("from long ago", 1)
    assert "'mine' was upgraded from 0" in drawer.note("mine") and (tmp_path / "mine.toml").read_text() == old
    drawer.save("mine", scenario)
    drawer.save("mine", dataclasses.replace(scenario, title="later"))
    assert (tmp_path / "mine.toml.bak").read_text() == old, "the original is gone"
    assert drawer.load("mine").title == "later" and drawer.note("mine") == "" and drawer.names() == ["mine"]
    (tmp_path / "mine.toml").write_text(old.replace("long ago", "yesterday"))  # put there by hand
    save(scenario, tmp_path / "mine.toml")
    assert (tmp_path / "mine.toml.bak").read_text() == old, "the first original is the one that stays"


# P6 ----------------------------------------------------------------------------------------------


@row("P6")
@pytest.mark.parametrize(
    ("old", "new", "path", "words"),
    [
        ("explore_deg", "explore_dg", "servo.explore_dg", "Did you mean 'explore_deg'"),
        ('camera = "left"\n', "", "tracker[0]", "the key 'camera' is missing"),
        ("fov_deg = 36.0", 'fov_deg = "36"', "camera[0].fov_deg", "expected a number, got '36'"),
        ("title", "titel", "titel", "Did you mean 'title'"),
        ("[scene]", "[y-scene]", "y-scene", "unknown key 'y-scene'"),
    ],
)
def test_what_a_file_should_not_hold_is_named_with_its_path(
    old: str, new: str, path: str, words: str
) -> None:
    text = dumps(dataclasses.replace(task(), servo=dataclasses.replace(task().servo, explore_deg=3.0)))
    assert old in text
    with pytest.raises(BadInput, match=re.escape(words)) as caught:
        loads(text.replace(old, new, 1), source="my.toml")
    assert caught.value.path == path and str(caught.value).startswith(f"my.toml: {path}: ")


@row("P6")
def test_keys_of_other_programs_are_kept_and_written_back(tmp_path: Path) -> None:
    view = {"zoom": 1.5, "open": [True, {"deep": []}]}
    ours = {"x-note": "by hand", "x-view": view, "x-list": [{"a": 1}, {}]}
    scenario = dataclasses.replace(task(), extra=ours)
    save(scenario, tmp_path / "x.toml")
    assert load(tmp_path / "x.toml") == scenario and load(tmp_path / "x.toml").extra == ours


@row("P6")
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("x-day = 1979-05-27", "x-day: expected text, numbers"),
        ("x-big = [" + "1," * 2000 + "]", "at most 2000 values"),
        ("x-deep = " + "[" * 9 + "]" * 9, "8 deep"),
        ("x-nan = [nan]", r"x-nan\[0\]: nan is not a finite number"),
    ],
)
def test_what_could_not_be_written_back_the_same_is_refused(line: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        loads(f"{line}\n{dumps(Scenario())}")


@row("P6")
def test_the_button_shows_the_refusal_of_an_unknown_key(moving: Bench) -> None:
    assert "Did you mean 'seed'" in refused(moving, "P6")


# P7 ----------------------------------------------------------------------------------------------


def small() -> Scenario:
    """A task whose file is short, so that every place of it can be damaged."""
    one = task()
    first = {"tracker": one.tracker[:2], "constraint": one.constraint[:1], "camera": one.camera[:1]}
    return dataclasses.replace(one, **first)


def outcome(data: bytes) -> Scenario | None:
    """What a file gives; None when it is refused."""
    try:
        return loads(data, "file")
    except BadInput:
        return None


@row("P7")
def test_a_file_cut_anywhere_is_refused() -> None:
    data = sealed(dumps(small())).encode()
    assert [end for end in range(len(data)) if outcome(data[:end]) is not None] == []
    assert outcome(data) == small()


@row("P7")
def test_no_single_bit_makes_another_task_of_a_file() -> None:
    """Refused, or (in the words of the first line) the very same task."""
    data, same = sealed(dumps(small())).encode(), 0
    first = data.index(b"\n")
    for place in range(len(data)):
        for bit in range(8):
            flipped = bytearray(data)
            flipped[place] ^= 1 << bit
            got = outcome(bytes(flipped))
            assert got is None or (got == small() and place < first), (place, bit)
            same += got is not None
    assert same > 0, "nothing of the first line is free, so this proved less than it says"


@row("P7")
def test_files_written_by_hand_need_no_check_sum_and_edited_ones_say_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    save(small(), path)
    text = path.read_text()
    assert text.startswith("# vita task, sha256 ")
    path.write_text(text.replace('title = "bench"', 'title = "edited"'))
    with pytest.raises(BadInput, match=r"mine\.toml: line 1: .*damaged, or was edited by hand: then delete"):
        load(path)
    path.write_text(path.read_text().partition("\n")[2])
    assert load(path).title == "edited"
    path.write_bytes(text.replace("\n", "\r\n").encode())
    assert load(path) == small(), "the line ends of Windows change no task"


@row("P7")
def test_the_button_shows_that_one_bit_is_noticed(moving: Bench) -> None:
    assert "damaged" in refused(moving, "P7")


# P8 ----------------------------------------------------------------------------------------------


@row("P8")
def test_two_pages_cannot_write_over_each_other_unseen(tmp_path: Path, moving: Bench) -> None:
    drawer, other = Drawer(tmp_path), Drawer(tmp_path)
    one, two = (dataclasses.replace(Scenario(), title=title) for title in ("one", "two"))
    drawer.save("t", one, "ann")
    for page, who in ((drawer, "bob"), (other, "ann")):  # another page of this app, and another app
        with pytest.raises(BadInput, match="'t' exists already; save under another name, or load it first"):
            page.save("t", two, who)
    assert drawer.load("t", "bob") == one
    drawer.save("t", two, "bob")
    with pytest.raises(BadInput, match="'t' was saved meanwhile from another page; save under another name"):
        drawer.save("t", one, "ann")
    drawer.save("t again", one, "ann")
    assert drawer.load("t", "ann") == two
    drawer.save("t", one, "ann")
    assert drawer.load("t") == one
    assert "exists already" in refused(moving, "P8")


@row("P8")
def test_a_page_that_was_reloaded_is_the_same_one() -> None:
    lease = Lease(lambda: 0.0)
    for client, token in ((1, "ann's browser"), (2, "ann's browser"), (3, "bob's browser"), (4, None)):
        lease.opened(client)
        if token is not None:
            lease.showed(client, token)
    assert lease.identity(1) == lease.identity(2)
    assert len({lease.identity(client) for client in (1, 3, 4, 5)}) == 4


# T5, T7, T8, T9 ----------------------------------------------------------------------------------


@row("T5")
def test_a_line_without_length_is_refused_with_its_path(moving: Bench) -> None:
    line = TrackerSpec("edge", "left", "line", at=(20.0, 20.0), to=(22.0, 21.0))
    with pytest.raises(BadInput) as caught:
        loads(dumps_unchecked(dataclasses.replace(task(), tracker=(*task().tracker, line))))
    assert caught.value.path == "tracker[12].to"
    assert "'edge' has no direction: its ends are 2.2 px apart" in str(caught.value)
    places = {"p": 9.0, "a": 60.0, "b": 61.0}
    ends = tuple(TrackerSpec(name, "left", "fixed", at=(u, 50.0)) for name, u in places.items())
    flat = ConstraintSpec("flat", "point_to_line", ("p", "a", "b"))
    with pytest.raises(BadInput) as caught:
        loads(dumps_unchecked(dataclasses.replace(task(), tracker=ends, constraint=(flat,))))
    assert caught.value.path == "constraint[0].points[2]" and "'a' and 'b'" in str(caught.value)
    assert "'no line'" in refused(moving, "T5")


def dumps_unchecked(scenario: Scenario) -> str:
    """The text of a scenario that should not be one."""
    from vita.scenario.emit import document
    from vita.scenario.typed import plain

    return document(plain(scenario))


HOSTILE_NUMBERS = [
    "nan", "inf", "-inf", "1e200", "1e6", "true", '"312"', "1979-05-27", "[1]", "{}", "9" * 400,
]  # fmt: skip


@row("T7")
@pytest.mark.parametrize("value", HOSTILE_NUMBERS, ids=lambda v: v[:12])
@pytest.mark.parametrize("key", ["at", "weight", "fov_deg", "q0_deg"])
def test_what_is_no_sensible_number_is_refused_with_its_path(key: str, value: str) -> None:
    goal = TrackerSpec("goal", "left", "fixed", at=(123.0, 45.0))
    weighed = dataclasses.replace(task().constraint[0], weight=7.0)
    text = dumps(dataclasses.replace(task(), tracker=(*task().tracker, goal), constraint=(weighed,)))
    old, new, path = {
        "at": ("at = [123.0", f"at = [{value}", "tracker[12].at[0]"),
        "weight": ("weight = 7.0", f"weight = {value}", "constraint[0].weight"),
        "fov_deg": ("fov_deg = 36.0", f"fov_deg = {value}", "camera[0].fov_deg"),
        "q0_deg": ("q0_deg = [0.0", f"q0_deg = [{value}", "scene.q0_deg[0]"),
    }[key]
    assert text.count(old) >= 1
    with pytest.raises(BadInput) as caught:
        loads(text.replace(old, new, 1))
    assert caught.value.path == path


@row("T7")
def test_minus_zero_is_zero(moving: Bench) -> None:
    minus = loads(BENCH.replace("q0_deg = [0.0", "q0_deg = [-0.0", 1))
    assert repr(minus) == repr(loads(BENCH)) and "-0.0" not in repr(minus.scene)
    assert "tracker[12].at[0]: nan is not a finite number" in refused(moving, "T7")


@row("T8")
@pytest.mark.parametrize(
    ("old", "new", "path", "words"),
    [
        ('camera = "left"', 'camera = "lft"', "tracker[0].camera", "Did you mean 'left'"),
        ('"tip0_l", "goal0_l"', '"tip0_l", "gaol0_l"', "constraint[0].points[1]", "Did you mean 'goal0_l'"),
        ('kind = "point_to_point"', 'kind = "point_to_pt"', "constraint[0].kind", "Did you mean 'point_to_"),
        ('name = "right"', 'name = "left"', "camera[1].name", "taken by camera[0]"),
        ('name = "goal0_l"', 'name = "tip0_l"', "tracker[1].name", "taken by tracker[0]"),
        ('name = "meet 1 left"', 'name = "meet 0 left"', "constraint[1].name", "taken by constraint[0]"),
    ],
)
def test_unknown_and_doubled_names_are_refused_with_their_path(
    old: str, new: str, path: str, words: str
) -> None:
    text = dumps(task())
    assert old in text
    with pytest.raises(BadInput, match=re.escape(words)) as caught:
        loads(text.replace(old, new, 1))
    assert caught.value.path == path


@row("T8")
def test_the_button_shows_the_refusal_of_an_unknown_camera(moving: Bench) -> None:
    assert "tracker[12].camera: unknown camera 'lef#'. Did you mean 'left'" in refused(moving, "T8")


@row("T9")
@pytest.mark.parametrize(("key", "most"), [("tracker", 64), ("constraint", 64), ("camera", 4)])
def test_there_is_a_limit_on_everything_and_it_is_named(key: str, most: int) -> None:
    def times(count: int) -> Scenario:
        one = getattr(task(), key)[0]
        more = tuple(dataclasses.replace(one, name=f"more {i}") for i in range(count))
        kept = getattr(task(), key) if key != "constraint" else ()
        return dataclasses.replace(task(), **{key: (*kept, *more)})

    fits = most - (0 if key == "constraint" else len(getattr(task(), key)))
    assert len(getattr(loads(dumps(times(fits))), key)) == most
    with pytest.raises(BadInput, match=f"at most {most} are possible, got {most + 1}") as caught:
        loads(dumps_unchecked(times(fits + 1)))
    assert caught.value.path == key


@row("T9")
@pytest.mark.parametrize("weight", ["0", "-1", "1e12", "-0.0"])
def test_a_weight_that_is_none_is_refused(weight: str, moving: Bench) -> None:
    weighed = dataclasses.replace(task().constraint[0], weight=7.0)
    text = dumps(dataclasses.replace(task(), constraint=(weighed,)))
    with pytest.raises(BadInput) as caught:
        loads(text.replace("weight = 7.0", f"weight = {weight}"))
    assert caught.value.path == "constraint[0].weight"
    assert "at most 64 are possible" in refused(moving, "T9")


# U11 ---------------------------------------------------------------------------------------------

BENCH = dumps(task())
PLAIN = 'schema = 1\n[scene]\nrobot = "wam7"\n'
HOSTILE: dict[str, Callable[[], bytes]] = {
    "lists in lists": lambda: b"x = " + b"[" * 100_000,
    "closed lists in lists": lambda: b"x = " + b"[" * 100_000 + b"]" * 100_000,
    "tables in tables": lambda: b"x = " + b"{ a = " * 100_000,
    "dotted keys": lambda: ("a" + ".a" * 100_000 + " = 1").encode(),
    "dotted tables": lambda: ("[a" + ".a" * 100_000 + "]").encode(),
    "a number of a million digits": lambda: b"schema = " + b"9" * 999_000,
    "a fraction of a million digits": lambda: b"schema = 1\nseed = 0." + b"9" * 900_000,
    "doubled keys": lambda: PLAIN.encode() + b"schema = 1\n" + PLAIN.encode(),
    "a byte-order mark": lambda: b"\xef\xbb\xbf" + PLAIN.encode(),
    "UTF-16": lambda: PLAIN.encode("utf-16"),
    "YAML with a tag": lambda: b"--- !!python/object/apply:os.system ['true']\n",
    "a pickle": lambda: b"\x80\x04\x95\x1c\x00\x00\x00cposix\nsystem\n(S'true'\ntR.",
    "JSON": lambda: b'{"schema": 1, "scene": {"robot": "wam7"}}',
    "a zip bomb": lambda: b"PK\x03\x04" + bytes(900_000),
    "markup in a name": lambda: PLAIN.encode() + b'[[camera]]\nname = "<img src=x onerror=alert(1)>"\n',
    "a robot from anywhere": lambda: PLAIN.replace("wam7", "../../../../etc/passwd").encode(),
    "quotes without end": lambda: b'title = "' + b"a" * 900_000,
    "a million tables": lambda: b"[[tracker]]\n" * 80_000,
    "keys by the thousand": lambda: "".join(f"k{i} = 1\n" for i in range(60_000)).encode(),
    "one giant comment": lambda: b"#" * 990_000,
    "tables by the thousand": lambda: b"[[tracker]]\n" * 20_000,
    "brackets below the limit": lambda: b"x = " + b"[" * 4999,
    "tables in tables below the limit": lambda: b"x = " + b"{ a = " * 4999,
    "digits below the limit": lambda: b"seed = " + b"9" * 249_000,
    "keys below the limit": lambda: "".join(f"k{i} = 1\n" for i in range(5999)).encode(),
    "tables below the limit": lambda: b"[[tracker]]\n" * 2499,
    "items below the limit": lambda: b"x-list = [" + b"1," * 11_999 + b"]\n" + PLAIN.encode(),
    "text below the limit": lambda: b'schema = 1\ntitle = "' + b"a" * 249_000 + b'"',
    "two megabytes": lambda: b"#" * 2_000_000,
}


@row("U11")
@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_quickly_and_in_little_memory(kind: str) -> None:
    """50 ms, or what this machine needs for thirty sensible files; and 20 MB."""
    data = HOSTILE[kind]()
    normal = min(seconds(lambda: loads(BENCH)) for _ in range(3))
    taken = min(seconds(lambda: outcome(data)) for _ in range(3))
    assert taken < max(0.05, 30 * normal), f"{1e3 * taken:.0f} ms, a sensible file {1e3 * normal:.0f} ms"
    tracemalloc.start()
    with pytest.raises(BadInput) as caught:
        loads(data, "upload")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6, f"{peak / 1e6:.0f} MB"
    assert len(str(caught.value)) < 1000 and str(caught.value).startswith("upload: ")


def seconds(function: Callable[[], object]) -> float:
    """What it costs this process, whatever else the machine does [s]."""
    started = time.process_time()
    function()
    return time.process_time() - started


@row("U11")
def test_the_button_shows_the_refusal_of_a_hostile_file(moving: Bench) -> None:
    assert "more than 5000 times the sign '['" in refused(moving, "U11")


def test_an_injected_refusal_that_is_none_is_an_error_of_ours() -> None:
    """Otherwise a button could claim a refusal that never happens."""
    from vita.faults.refusal import refused as attempt

    with pytest.raises(AssertionError, match="nothing was accepted"):
        attempt("nothing", lambda: None)


# By the thousand ---------------------------------------------------------------------------------


def test_spoiled_files_are_refused_with_a_place_or_are_tasks_that_read_back_the_same() -> None:
    """`vita fuzz files` in small."""
    report = files.run(2.0, seed=20)
    assert report.passed, report.violations[0][:2000]
    assert report.tried >= 20 and 0 < report.figures["accepted"] < 0.6 * report.tried


@pytest.mark.parametrize("spoil", files.WAYS, ids=lambda spoil: spoil.__name__)
def test_every_way_to_spoil_a_file_spoils_some(spoil: Callable[[random.Random, str], bytes]) -> None:
    """And the seed says which."""
    chance = random.Random(1)
    accepted = [files.judge(spoil(chance, BENCH))[0] for _ in range(40)]
    assert not all(accepted)
    assert len({spoil(random.Random(2), BENCH) for _ in range(3)}) == 1


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (KeyError("at"), "KeyError"),
        (RecursionError(), "RecursionError"),
        (BadInput("no"), "does not say where"),
        (BadInput("line 3: " + "x" * 3000), "a message of"),
        (Scenario(title="a"), "not read back the same"),
        (Scenario(seed=-1), "cannot be saved"),
    ],
)
def test_the_fuzzer_sees_what_is_dealt_with_wrongly(
    answer: Exception | Scenario, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def loads_badly(text: object, source: str = "") -> Scenario:
        if isinstance(answer, Exception):
            raise answer
        return answer if source else Scenario(title="another")

    monkeypatch.setattr(files, "loads", loads_badly)
    assert words in files.judge(b"")[1]


def test_the_fuzzer_reports_a_violation_with_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "judge", lambda data: (False, "went wrong"))
    report = files.run(0.2, seed=3)
    assert not report.passed and "seed 3, file 0: went wrong; b'" in report.violations[0]
