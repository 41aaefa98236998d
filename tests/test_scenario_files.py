"""Scenario files: nothing is lost on the way to the disk and back, and nothing wrong gets in."""

from __future__ import annotations

import dataclasses
import math
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scenario_strategy import scenarios
from task_text import TASK

from vita.errors import BadInput, UnknownName
from vita.scenario.library import find, shipped
from vita.scenario.overrides import override
from vita.scenario.schema import CameraSpec, Scenario, SceneSpec, ScriptSpec
from vita.scenario.toml_io import MAX_BYTES, dumps, load, loads, save
from vita.scenario.typed import plain
from vita.scenario.validate import validate
from vita.servo.config import ServoConfig

# Shrinking a whole scenario takes minutes; the first counter-example says enough.
RELAXED = settings(
    deadline=None,
    derandomize=True,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.generate],
)

# Nothing is lost ---------------------------------------------------------------------------------


@RELAXED
@given(scenarios())
def test_what_is_written_reads_back_equal(scenario: Scenario) -> None:
    text = dumps(scenario)
    again = loads(text)
    assert again == scenario
    assert repr(again) == repr(validate(scenario))  # to the type: 1.0 is not 1, a tuple is not a list
    assert dumps(again) == text


@RELAXED
@given(scenarios())
def test_the_text_is_plain_toml_with_the_schema_first(scenario: Scenario) -> None:
    """Another TOML reader sees exactly the keys that differ from their defaults."""
    text = dumps(scenario)
    assert text.startswith("schema = 1\n")
    assert tomllib.loads(text) == plain(validate(scenario))


def test_every_key_of_the_schema_can_be_written_and_read() -> None:
    scenario = loads(TASK)
    assert loads(dumps(scenario)) == scenario
    assert scenario.camera[0] == CameraSpec("left", (1.2, -0.9, 0.7), (0.45, 0.0, 0.25))
    assert scenario.script[1] == ScriptSpec(1.0, "set", {"field": "servo.gain", "value": 0.25})
    assert isinstance(scenario.servo.gain, float) and isinstance(scenario.seed, int)


def test_defaults_are_left_out_but_the_robot_is_named() -> None:
    assert dumps(Scenario()) == 'schema = 1\n\n[scene]\nrobot = "wam7"\n'


def test_written_files_are_tidy() -> None:
    """One line per value, and the order of the design's sample."""
    text = dumps(loads(TASK))
    assert "look_from = [1.2, -0.9, 0.7]\n" in text
    assert max(map(len, text.splitlines())) <= 120
    heads = [line for line in text.splitlines() if line.startswith("[")]
    order = ["[scene]", "[[camera]]", "[[tracker]]", "[[constraint]]", "[servo]", "[limits]", "[[script]]"]
    assert list(dict.fromkeys(heads)) == [*order, "[expect]"]


def test_scenarios_made_in_python_may_use_lists_whole_numbers_and_numpy() -> None:
    camera = CameraSpec("c", look_from=[1, 0, 0], look_at=np.zeros(3), size=np.array([640, 480]))  # type: ignore[arg-type]
    scene = SceneSpec(q0_deg=[0] * 7)  # type: ignore[arg-type]
    scenario = validate(Scenario(camera=[camera], scene=scene, seed=np.int64(3)))  # type: ignore[arg-type]
    assert scenario.camera == (CameraSpec("c", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),)
    assert type(scenario.scene.q0_deg) is tuple and type(scenario.seed) is int
    assert loads(dumps(scenario)) == scenario


# Saving ------------------------------------------------------------------------------------------


def test_save_and_load(tmp_path: Path) -> None:
    scenario = loads(TASK)
    save(scenario, tmp_path / "my task.toml")
    assert load(tmp_path / "my task.toml") == scenario
    assert os.listdir(tmp_path) == ["my task.toml"]


def test_a_save_that_fails_leaves_the_old_file_and_no_litter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "task.toml"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(BadInput, match="not saved: disk full"):
        save(Scenario(), path)
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["task.toml"]


def test_an_invalid_scenario_is_never_written(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"camera\[0\]\.fov_deg"):
        save(Scenario(camera=(CameraSpec("c", (1, 0, 0), (0, 0, 0), fov_deg=math.nan),)), tmp_path / "x.toml")
    assert not os.listdir(tmp_path)


def test_saving_to_a_place_that_is_not_there_is_a_clear_error(tmp_path: Path) -> None:
    for path in (tmp_path / "no" / "x.toml", tmp_path):
        with pytest.raises(BadInput, match="not saved: "):
            save(Scenario(), path)
    assert not os.listdir(tmp_path)


def test_saving_through_a_link_keeps_the_link(tmp_path: Path) -> None:
    (tmp_path / "real.toml").write_text("old")
    (tmp_path / "link.toml").symlink_to(tmp_path / "real.toml")
    save(Scenario(), tmp_path / "link.toml")
    assert (tmp_path / "link.toml").is_symlink() and load(tmp_path / "real.toml") == Scenario()


# Nothing wrong gets in ---------------------------------------------------------------------------

WRONG = [
    # old text, new text, path of the culprit, part of the message
    ("schema = 1\n", "", "schema", "schema = 1"),
    ("schema = 1", "schema = 2", "schema", "by version 2 of the format; this is 1: install a newer vita"),
    ("schema = 1", "schema = 0", "schema", "no schema 0"),
    ("schema = 1", 'schema = "1"', "schema", "whole number"),
    ("seed = 7", "sead = 7", "sead", "Did you mean 'seed'"),
    ("seed = 7", "seed = 7.5", "seed", "whole number"),
    ("seed = 7", "seed = -1", "seed", "outside"),
    ("seed = 7", "seed = true", "seed", "whole number"),
    ("seed = 7", 'description = "a\\u0000b"', "description", "control character"),
    ('robot = "wam7"', 'robot = "wamm7"', "scene.robot", "wam7"),
    ('robot = "wam7"', 'robot = "nowhere.urdf"', "scene.robot", "no file"),
    ('robot = "wam7"', 'robot = "/dev/zero"', "scene.robot", "unknown robot"),
    ('robot = "wam7"', 'robbot = "wam7"', "scene.robbot", "Did you mean 'robot'"),
    ("110, 0, 15, 0]", "110, 0, 15]", "scene.q0_deg", "7 joints, got 6"),
    ("-35, 0, 110", "-350, 0, 110", "scene.q0_deg[1]", "outside the joint's"),
    ('tool = "card_tool"', 'tool = "card_tol"', "scene.tool", "Did you mean 'card_tool'"),
    ('kind = "card"', 'kind = "cart"', "scene.objects[0].kind", "Did you mean 'card'"),
    ('name = "card"', 'name = "link2"', "scene.objects[0].name", "taken by the robot"),
    ('name = "card"', 'name = "world"', "scene.objects[0].name", "taken by the robot"),
    ("xyz = [0.55, 0.10, 0.02]", "xyz = [0.55, 0.10]", "scene.objects[0].xyz", "3 values, got 2"),
    ("xyz = [0.55, 0.10, 0.02]", "xyz = 0.5", "scene.objects[0].xyz", "list of 3"),
    ("xyz = [0.55, 0.10, 0.02]", 'xyz = [0.5, 0.1, "a"]', "scene.objects[0].xyz[2]", "a number"),
    ("rpy_deg = [0, 0, 20] }", "rpy = [0, 0, 20] }", "scene.objects[0].rpy", "Did you mean 'rpy_deg'"),
    ('name = "hand"', 'name = "left"', "camera[1].name", "taken by camera[0]"),
    ('name = "hand"', 'name = "ha/nd"', "camera[1].name", "not a name"),
    ('name = "hand"', 'name = ""', "camera[1].name", "not a name"),
    ('name = "hand"', f'name = "{"a" * 65}"', "camera[1].name", "not a name"),
    ('name = "hand"\n', "", "camera[1]", "'name' is missing"),
    ("look_at = [0.45, 0.0, 0.25]\n", "", "camera[0].look_at", "needs look_from and look_at"),
    ("look_at = [0.45, 0.0, 0.25]", "look_at = [1.2, -0.9, 0.7]", "camera[0].look_at", "stands"),
    ('mount = "tool"', 'mount = "tool"\nlook_at = [1, 2, 3]', "camera[1].look_at", "not both"),
    ('mount = "tool"', 'mount = "tol"', "camera[1].mount", "Did you mean 'tool'"),
    ("fov_deg = 50", "fov_deg = 50\nxyz = [1, 0, 0]", "camera[0].xyz", "mount"),
    ("fov_deg = 50", "fov_deg = nan", "camera[0].fov_deg", "finite"),
    ("fov_deg = 50", "fov_deg = 1e999", "camera[0].fov_deg", "finite"),
    ("fov_deg = 50", "fov_deg = true", "camera[0].fov_deg", "a number, got true"),
    ("fov_deg = 50", 'fov_deg = "50"', "camera[0].fov_deg", "a number, got '50'"),
    ("fov_deg = 50", "fov_deg = 1979-05-27", "camera[0].fov_deg", "a number, got a date"),
    ("fov_deg = 50", "fov_deg = 180", "camera[0].fov_deg", "outside 1 to 170"),
    ("size = [640, 480]", "size = [640.0, 480]", "camera[0].size[0]", "whole number"),
    ("size = [640, 480]", "size = [64000, 480]", "camera[0].size[0]", "outside"),
    ('name = "corner_l"', 'name = "tip_l"', "tracker[1].name", "taken by tracker[0]"),
    ('camera = "left"\nkind = "auto"', 'camera = "lft"', "tracker[0].camera", "Did you mean 'left'"),
    ('kind = "auto"', 'kind = "autoo"', "tracker[0].kind", "Did you mean 'auto'"),
    ('kind = "auto"', 'kind = "auto"\nnoise = {}', "tracker[0].noise", "projected"),
    ('kind = "auto"', 'kind = "projected"', "tracker[0]", "needs attach"),
    ("at = [312.0, 208.5]\n", "", "tracker[0]", "at = [u, v] or attach"),
    ("at = [312.0, 208.5]", "at = [312.0]", "tracker[0].at", "2 values, got 1"),
    ("at = [312.0, 208.5]", "at = [3120.0, 208.5]", "tracker[0].at", "outside the image of 'left'"),
    ("at = [320, 240]", "at = [320, 1e6]", "tracker[2].at[1]", "outside"),
    ('kind = "fixed"', 'kind = "fixed"\nattach = { body = "card" }', "tracker[2].attach", "not both"),
    ('body = "card"', 'body = "cart"', "tracker[1].attach.body", "Did you mean 'card'"),
    ('kind = "gaussian"', 'kind = "gausian"', "tracker[1].noise.kind", "Did you mean 'gaussian'"),
    ('kind = "gaussian"', 'kind = "integer"', "tracker[1].noise.sigma_px", "gaussian"),
    ("sigma_px = 0.2", "sigma_px = -0.2", "tracker[1].noise.sigma_px", "outside"),
    ('kind = "point_to_point"', 'kind = "point_to_pont"', "constraint[0].kind", "Did you mean 'point_to"),
    ('kind = "point_to_point"', 'kind = "line_to_line"', "constraint[0].points", "4 trackers, got 2"),
    ('kind = "point_to_point"', 'kind = "parallel_lines"', "constraint[0].points", "4 trackers, got 2"),
    ('kind = "point_to_point"', 'kind = "point_to_line"', "constraint[0].points", "3 trackers, got 2"),
    ('["tip_l", "corner_l"]', '["tip_l", "corner"]', "constraint[0].points[1]", "Did you mean 'corner_l'"),
    ('["tip_l", "corner_l"]', '["tip_l", "tip_l"]', "constraint[0].points[1]", "used twice"),
    ('["tip_l", "corner_l"]', '["tip_l", "goal_h"]', "constraint[0].points[1]", "each view has its own"),
    ('["tip_l", "corner_l"]', '["tip_l", 3]', "constraint[0].points[1]", "text in quotes, got 3"),
    ("weight = 1.0", "weight = 0", "constraint[0].weight", "above 0"),
    ("weight = 1.0", "weight = 1e4", "constraint[0].weight", "outside"),
    ("gain = 1\n", "gian = 1\n", "servo.gian", "Did you mean 'gain'"),
    ("gain = 1\n", "gain = 3\n", "servo.gain", "outside 0.01 to 2.0"),
    ("joints = [0, 1, 2, 3]", "joints = [0, 7]", "servo.joints[1]", "joints 0 to 6, got 7"),
    ("joints = [0, 1, 2, 3]", "joints = []", "servo.joints", "at least one"),
    ("joints = [0, 1, 2, 3]", "joints = [1, 1]", "servo.joints", "twice"),
    ("speed_rad_s = 0.6", "speed_rad_s = 60", "limits.speed_rad_s", "outside"),
    ("joint = 0, lower", "joint = 7, lower", "limits.joint[0].joint", "joints 0 to 6"),
    ("lower_deg = -90", "lower_deg = 170", "limits.joint[0]", "not below the upper"),
    ('do = "start"', 'do = "strat"', "script[0].do", "Did you mean 'start'"),
    ('do = "start"', 'do = "start"\nnow = 1', "script[0].now", "takes no arguments"),
    ('do = "start"\n', "", "script[0]", "'do' is missing"),
    ("at_s = 0.0", "at_s = -1", "script[0].at_s", "outside"),
    ('field = "gain"', 'field = "gian"', "script[1].field", "servo.gain, servo.alpha"),
    ("value = 0.25", "value = 25", "script[1].value", "outside 0.01 to 2.0"),
    ("value = 0.25", 'value = "fast"', "script[1].value", "a number"),
    ("value = 0.25\n", "", "script[1]", "needs the key 'value'"),
    ('camera = "left"\nlook_from = [1, 2', 'camera = "up"\nlook_from = [1, 2', "script[2].camera", "left"),
    ("look_from = [1, 2, 3]", "look_fro = [1, 2, 3]", "script[2].look_fro", "Did you mean 'look_from'"),
    ("look_from = [1, 2, 3]", "look_from = [1, 2, inf]", "script[2].look_from[2]", "finite"),
    ("dq_deg = [1, 2]", "dq_deg = [1, 2, 3, 4, 5, 6, 7, 8]", "script[3].dq_deg", "7 joints, got 8"),
    ('outcome = "converged"', 'outcome = "won"', "expect.outcome", "Choices: converged, limited, held"),
    ('outcome = "converged"', 'outcom = "held"', "expect.outcom", "Did you mean 'outcome'"),
    ('outcome = "converged"', 'reason = "tracker_lst"', "expect.reason", "Did you mean 'tracker_lost'"),
    ('to = "card"', 'to = "cart"', "expect.final_distance_mm.to", "Did you mean 'card'"),
    (", max = 2.0", "", "expect.final_distance_mm", "'max' is missing"),
    ("[scene]\n", "[[scene]]\n", "scene", "expected a table, got a list"),
    ("[servo]\n", "servo = 3\n[servoo]\n", None, ""),
]


@pytest.mark.parametrize(
    ("old", "new", "path", "words"), WRONG, ids=[f"{row[2]}-{i}" for i, row in enumerate(WRONG)]
)
def test_a_mistake_is_refused_with_its_path(old: str, new: str, path: str | None, words: str) -> None:
    """The message names the file, the culprit's path and the way out, in one short paragraph."""
    assert TASK.count(old) >= 1
    with pytest.raises(BadInput) as caught:
        loads(TASK.replace(old, new, 1), source="my.toml")
    message = str(caught.value)
    assert message.startswith("my.toml: ") and words in message and len(message) < 1000
    if path is not None:
        assert caught.value.path == path and f"my.toml: {path}: " in message


def test_the_choices_travel_with_the_error() -> None:
    with pytest.raises(UnknownName) as caught:
        loads(TASK.replace('do = "start"', 'do = "go"'))
    assert "start" in caught.value.choices and caught.value.name == "go"


@pytest.mark.parametrize(
    ("key", "most"), [("camera", 4), ("tracker", 64), ("constraint", 64), ("script", 256)]
)
def test_there_are_never_too_many(key: str, most: int) -> None:
    task = loads(TASK)
    if key != "constraint":
        task = dataclasses.replace(task, constraint=())
    first, *rest = getattr(task, key)
    more = most - len(rest) - 1
    many = [dataclasses.replace(first, **({"name": f"n{i}"} if key != "script" else {})) for i in range(more)]
    full = dataclasses.replace(task, **{key: (first, *rest, *many)})
    assert validate(full) == full
    over = dataclasses.replace(first, **({"name": "over"} if key != "script" else {}))
    with pytest.raises(BadInput, match=f"{key}: at most {most} are possible, got {most + 1}"):
        validate(dataclasses.replace(full, **{key: (*getattr(full, key), over)}))


# Hostile files -----------------------------------------------------------------------------------

HOSTILE = {
    "deep lists": "schema = 1\nx = " + "[" * 100_000,
    "deep closed lists": "schema = 1\nx = " + "[" * 5000 + "]" * 5000,
    "deep tables": "schema = 1\nx = " + "{a=" * 5000 + "1" + "}" * 5000,
    "deep dotted key": "schema = 1\n" + "a." * 200_000 + "a = 1\n",
    "deep header": "schema = 1\n[" + "a." * 200_000 + "a]\n" + "".join(f"k{i}=1\n" for i in range(9000)),
    "deep quoted key": "schema = 1\n" + '"a" . ' * 20_000 + "a = 1\n",
    "a number of a million digits": "schema = 1\nseed = " + "9" * 900_000,
    "a hex number of a million digits": "schema = 0x" + "f" * 900_000,
    "a float of a million digits": "schema = 1\n[servo]\ngain = 0." + "9" * 900_000 + "e999999999",
    "a number beyond 64 bits": "schema = 1\nseed = 99999999999999999999",
    "a key of a million letters": "schema = 1\n" + "k" * 900_000 + " = 1",
    "a name of a million letters": TASK.replace('kind = "auto"', f'kind = "{"x" * 900_000}"'),
    "a string that never ends": 'schema = 1\ntitle = """' + "x" * 900_000,
    "many cameras": "schema = 1\n" + "[[camera]]\nname = 'x'\n" * 40_000,
    "many keys": "schema = 1\n" + "".join(f"key{i} = 1\n" for i in range(60_000)),
    "duplicate key": TASK.replace("seed = 7", "seed = 7\nseed = 8"),
    "duplicate table": TASK + "[servo]\n",
    "byte-order mark": "\ufeff" + TASK,
    "not TOML": "<html><body>not found</body></html>",
    "JSON": '{"schema": 1}',
    "empty": "",
    "a date as schema": "schema = 9999-99-99",
    "control character": "schema = 1\ntitle = 'a\x01b'",
    "only a list": "schema = [1]",
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_in_a_sentence(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "hostile.toml"
    path.write_text(HOSTILE[kind], encoding="utf-8")
    with pytest.raises(BadInput) as caught:
        load(path)
    assert "hostile.toml" in str(caught.value) and len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (TASK.encode("utf-16"), "UTF-16"),
        (b"\xfe\xff" + TASK.encode("utf-16-be"), "UTF-16"),
        (TASK.encode("utf-16-le"), "line 1: holds a zero byte"),
        (b"\xef\xbb\xbf" + TASK.encode(), "byte-order mark"),
        (TASK.encode().replace(b"corner with", b"corner\xff with"), "line 2: not a text file in UTF-8"),
        (b"\x7fELF\x02\x01\x01\x00" + bytes(100), "line 1"),
        (b"#" * (MAX_BYTES + 1), "larger than 250 kB"),
        (TASK.encode().replace(b"seed = 7", b"seed = "), "line 3"),
        (TASK.encode().replace(b"seed = 7", b"seed = 7\nseed = 7"), "line 4"),
        (b"schema = 1\nseed = " + b"9" * 10_000, "line 2"),
    ],
)
def test_files_that_are_not_toml_say_why_and_where(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(data)
    with pytest.raises(BadInput, match=words):
        load(path)


def test_a_cut_file_is_refused_or_holds_only_what_came_before_the_cut() -> None:
    """Cut anywhere: no value but the very last one may come out different from the whole file's."""
    whole = tomllib.loads(TASK)
    accepted = 0
    for end in range(0, len(TASK), 3):
        try:
            loads(TASK[:end])
        except BadInput:
            continue
        accepted += 1
        at_line_end = TASK[end - 1] == "\n" or TASK[end] == "\n"
        differences = _not_leading(tomllib.loads(TASK[:end]), whole)
        assert differences == 0 if at_line_end else differences <= 1, TASK[:end][-60:]
    assert 0 < accepted < len(TASK) / 3 / 4


def _not_leading(part: object, whole: object) -> int:
    """How many values of `part` are not in the same place of `whole`."""
    if isinstance(part, dict) and isinstance(whole, dict):
        return sum(_not_leading(value, whole[key]) if key in whole else 1 for key, value in part.items())
    if isinstance(part, list) and isinstance(whole, list):
        return sum(_not_leading(a, b) for a, b in zip(part, whole, strict=False))
    return int(part != whole)


@RELAXED
@given(st.binary(max_size=300) | st.text(max_size=300).map(lambda text: text.encode("utf-8", "replace")))
def test_rubbish_never_ends_in_anything_but_a_clear_error(rubbish: bytes) -> None:
    position = len(rubbish) * 7 % len(TASK)
    spoiled = TASK.encode()[:position] + rubbish + TASK.encode()[position:]
    try:
        loads(spoiled.decode("utf-8", "replace"))
    except BadInput as error:
        assert len(str(error)) < 1000


# Finding files -----------------------------------------------------------------------------------


def test_every_shipped_scenario_saves_back_identical() -> None:
    for name in shipped():
        scenario = load(name)
        assert loads(dumps(scenario)) == scenario


def test_names_that_are_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownName) as caught:
        load("no_such_task")
    assert caught.value.choices == tuple(shipped())
    for wrong in ("no_such.toml", "./no_such", "x" * 5000 + "/y", tmp_path, "a\0b"):
        with pytest.raises(BadInput):
            find(wrong)


def test_a_robot_file_is_found_beside_the_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm.urdf").write_text(
        '<robot name="two"><link name="base"/><link name="a"/><link name="b"/>'
        '<joint name="j0" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        '<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    (tmp_path / "task.toml").write_text('schema = 1\n[scene]\nrobot = "arm.urdf"\nq0_deg = [10, 20]\n')
    monkeypatch.chdir("/")
    scenario = load(tmp_path / "task.toml")
    assert scenario.scene.robot == str(tmp_path / "arm.urdf")
    save(scenario, tmp_path / "copy.toml")
    assert load(tmp_path / "copy.toml") == scenario


# --set -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("assignment", "read", "value"),
    [
        ("servo.gain=0.25", lambda s: s.servo.gain, 0.25),
        ("servo.gain = 1", lambda s: s.servo.gain, 1.0),
        ("servo.joints=0,2", lambda s: s.servo.joints, (0, 2)),
        ("servo.joints=[0, 2]", lambda s: s.servo.joints, (0, 2)),
        ("seed=3", lambda s: s.seed, 3),
        ("title=Two words", lambda s: s.title, "Two words"),
        ('title="a=b"', lambda s: s.title, "a=b"),
        ("scene.table=false", lambda s: s.scene.table, False),
        ("scene.q0_deg[1]=-30", lambda s: s.scene.q0_deg[1], -30.0),
        ("camera[0].fov_deg=60", lambda s: s.camera[0].fov_deg, 60.0),
        ("camera[left].fov_deg=60", lambda s: s.camera[0].fov_deg, 60.0),
        ("tracker[corner_l].noise.sigma_px=2", lambda s: s.tracker[1].noise.sigma_px, 2.0),
        ("expect.within_s=3", lambda s: s.expect.within_s, 3.0),
        ("limits.speed_rad_s=0.3", lambda s: s.limits.speed_rad_s, 0.3),
    ],
)
def test_set_changes_one_value(assignment: str, read, value: object) -> None:
    task = loads(TASK)
    changed = override(task, [assignment])
    assert read(changed) == value and type(read(changed)) is type(value)
    assert override(task, []) == task


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("servo.gian=1", "Did you mean 'gain'"),
        ("srvo.gain=1", "Did you mean 'servo'"),
        ("servo.gain=fast", "expected a number, got 'fast'"),
        ("servo.gain=true", "expected a number, got true"),
        ("servo.gain=nan", "finite"),
        ("servo.gain=5", "outside 0.01 to 2.0"),
        ("servo.gain=", "expected a number"),
        ("servo.gain", "KEY=VALUE"),
        ("=3", "KEY=VALUE"),
        ("servo.gain.x=3", "no such part"),
        ("seed=1e3", "whole number"),
        ("camera.fov_deg=3", r"camera\[0\]\.fov_deg"),
        ("camera[lft].fov_deg=3", "Did you mean 'left'"),
        ("camera[9].fov_deg=3", "unknown entry '9'"),
        ("camera[-1].fov_deg=3", "unknown entry"),
        ("scene.robot=wam4", "4 joints"),
        ("a" * 100_000 + "=1", "unknown key"),
        ("servo..gain=1", "is not a key"),
        ("servo.gain=" + "[" * 50_000, "expected a number"),
    ],
)
def test_set_refuses_what_a_file_could_not_hold(assignment: str, words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        override(loads(TASK), [assignment])
    assert len(str(caught.value)) < 1000


def test_settings_that_fit_only_together_can_be_set_together() -> None:
    task = override(
        loads(TASK), ["scene.robot=wam4", "scene.q0_deg=0,0,0,90", "limits.joint=[]"]
    )
    assert task.scene.robot == "wam4"
    assert task.servo == ServoConfig(gain=1.0, explore_deg=4.0, joints=(0, 1, 2, 3))


# Drift -------------------------------------------------------------------------------------------


def test_the_script_knows_exactly_the_actions_of_the_simulation() -> None:
    """An action added to the simulation must be one that a file can ask for, and with the same names."""
    actions = pytest.importorskip("vita.sim.actions")
    from vita.scenario.actions import ACTIONS

    engine_own = {"start", "stop", "set", "lose_tracker"}
    assert set(ACTIONS) - engine_own == set(actions.ACTIONS)
    for name, (_, arguments, required) in actions.ACTIONS.items():
        assert set(ACTIONS[name].arguments) == set(arguments)
        assert set(ACTIONS[name].required) == set(required)
