"""The command line: exit codes are the verdict, and a caller's mistake is one clear line."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest
from task_text import TASK
from test_recording import SUMMARY_KEYS, make_record

import vita
from vita import cli
from vita.errors import BadInput, MissingDependency
from vita.faults import CATALOGUE, injectors
from vita.fuzz.base import Report
from vita.scenario.library import shipped
from vita.scenario.record import RunRecord
from vita.servo.insight import Finding


@pytest.fixture
def task(tmp_path: Path) -> str:
    (tmp_path / "task.toml").write_text(TASK)
    return str(tmp_path / "task.toml")


@pytest.fixture
def headless(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """Replaces the simulator; returns the list of what it was asked to run."""
    asked: list[tuple] = []

    def run_scenario(scenario, *, realtime=False, name="", **_) -> RunRecord:
        asked.append((scenario, realtime))
        if "broken" in name:
            raise BadInput("nothing there to hold on to", "tracker[0].at")
        changes: dict[str, Any] = {"scenario": scenario, "name": name}
        if "bad" in name:
            expect = {"outcome": False, "within_s": True}
            changes |= {"passed": False, "expect": expect, "outcome": "fault", "reason": "diverged"}
            changes |= {"message": "The error grew."}
        return make_record(**changes)

    module = ModuleType("vita.scenario.headless")
    vars(module).update(run_scenario=run_scenario)
    monkeypatch.setitem(sys.modules, "vita.scenario.headless", module)
    checkup = ModuleType("vita.scenario.checkup")
    finding = Finding("warning", "second_solution", "Also met with the hand turned by 180 degrees.")
    vars(checkup).update(check_up=lambda scenario: FakeCheckup("2 rows hold 2 of 4", (finding,)))
    monkeypatch.setitem(sys.modules, "vita.scenario.checkup", checkup)
    return asked


class FakeCheckup(NamedTuple):
    freedom: str
    findings: tuple[Finding, ...]

    def summary(self) -> dict[str, Any]:
        return {"freedom": self.freedom, "findings": [f.code for f in self.findings]}


def outcome(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = cli.main(arguments)
    out, err = capsys.readouterr()
    return code, out, err


def copies(task: str, *names: str) -> list[str]:
    for name in names:
        (Path(task).parent / name).write_text(TASK)
    return [str(Path(task).parent / name) for name in names]


# Usage -------------------------------------------------------------------------------------------


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert outcome(capsys, "--version")[:2] == (0, f"vita {vita.__version__}\n")
    code, out, _ = outcome(capsys, "--help")
    assert code == 0 and all(re.search(rf"^ +{verb}\b", out, re.MULTILINE) for verb in cli.VERBS)
    for verb in cli.VERBS:
        assert outcome(capsys, verb, "--help")[0] == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["frobnicate"],
        ["run"],
        ["check"],
        ["list", "extra"],
        ["run", "a", "--speed", "slow"],
        ["serve", "--port", "x"],
        ["--port", "70000"],
        ["--port", "9" * 5000],
        ["serve", "--robot", "r2d2"],
        ["run", "no_such_scenario"],
        ["run", "no_such.toml"],
        ["check", "."],
        ["check", ""],
        ["serve", "no_such_scenario"],
        ["serve", "x.toml", "--robot", "wam4"],
        ["no_such.toml"],
    ],
)
def test_a_callers_mistake_exits_with_2_and_says_so(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = outcome(capsys, *arguments)
    assert code == 2 and out == "" and "vita" in err and "Traceback" not in err


def test_an_unknown_scenario_lists_the_choices(capsys: pytest.CaptureFixture[str]) -> None:
    _, _, err = outcome(capsys, "run", "no_such_scenario")
    assert err.count("\n") == 1 and err.startswith("vita: unknown scenario 'no_such_scenario'.")
    assert all(name in err for name in shipped())


# run ---------------------------------------------------------------------------------------------


def test_run_prints_a_row_for_each_scenario_and_exits_with_0(
    task: str, headless: list, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = outcome(capsys, "run", task, task)
    assert (code, err) == (0, "") and len(out.splitlines()) == 3
    assert "converged" in out and "0.31" in out and "1.25" in out and out.splitlines()[1][0] in "✓+"


def test_run_json_is_one_object_a_line_and_nothing_else(
    task: str, headless: list, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, good = copies(task, "bad.toml", "good.toml")
    code, out, _ = outcome(capsys, "run", "--json", bad, good)
    rows = [json.loads(line) for line in out.splitlines()]
    assert code == 1 and [list(row) for row in rows] == [SUMMARY_KEYS] * 2
    assert [(row["scenario"], row["passed"]) for row in rows] == [(bad, False), (good, True)]


def test_a_failed_expectation_exits_with_1_and_is_named(
    task: str, headless: list, capsys: pytest.CaptureFixture[str]
) -> None:
    (bad,) = copies(task, "bad.toml")
    code, out, _ = outcome(capsys, "run", bad, task)
    assert code == 1 and "not met: outcome" in out and "not met: within_s" not in out
    assert "diverged" in out and "The error grew." in out


def test_a_scenario_that_cannot_run_does_not_stop_the_others(
    task: str, headless: list, capsys: pytest.CaptureFixture[str]
) -> None:
    broken, bad = copies(task, "broken.toml", "bad.toml")
    code, out, err = outcome(capsys, "run", "--json", broken, bad)
    assert code == 2 and len(out.splitlines()) == 1
    assert err.startswith(f"vita: {broken}: tracker[0].at: nothing there")


def test_every_file_is_read_before_the_first_one_runs(
    task: str, headless: list, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = outcome(capsys, "run", task, "missing.toml")
    assert code == 2 and out == "" and not headless


def test_set_reaches_the_run(task: str, headless: list, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--set", "servo.gain=0.25", "--set", "camera[left].fov_deg=60", "--speed", "realtime"]
    assert outcome(capsys, "run", task, *arguments)[0] == 0
    ((scenario, realtime),) = headless
    assert scenario.servo.gain == 0.25 and scenario.camera[0].fov_deg == 60 and realtime
    code, _, err = outcome(capsys, "run", task, "--set", "servo.gian=1")
    assert code == 2 and "Did you mean 'gain'" in err and len(headless) == 1


def test_out_writes_recording_and_plot_and_never_one_over_the_other(
    task: str, headless: list, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sub").mkdir()
    (other,) = copies(task, "sub/task.toml")
    out = tmp_path / "new" / "out"
    assert outcome(capsys, "run", task, other, "--out", str(out))[0] == 0
    stems = {"task", "task_2"}
    assert {path.name for path in out.iterdir()} == {s + e for s in stems for e in (".npz", ".json", ".png")}
    assert RunRecord.load(out / "task_2").name == other
    code, printed, err = outcome(capsys, "run", task, "--out", task)
    assert code == 2 and "cannot make the folder" in err and printed == ""


def test_a_missing_package_exits_with_3(
    task: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "vita.scenario.headless", None)  # an import of it now fails

    def gone(*_: object, **__: object) -> None:
        raise ModuleNotFoundError("No module named 'pybullet'", name="pybullet")

    module = ModuleType("vita.scenario.headless")
    vars(module).update(run_scenario=gone)
    monkeypatch.setitem(sys.modules, "vita.scenario.headless", module)
    checkup = ModuleType("vita.scenario.checkup")
    vars(checkup).update(check_up=gone)
    monkeypatch.setitem(sys.modules, "vita.scenario.checkup", checkup)
    for verb in ("run", "check"):
        code, _, err = outcome(capsys, verb, task)
        assert code == 3 and "'pybullet' is missing" in err and err.count("\n") == 1

    def no_screen(*_: object, **__: object) -> None:
        raise MissingDependency("OpenGL is missing")

    vars(module).update(run_scenario=no_screen)
    assert outcome(capsys, "run", task)[0] == 3


# check and list ----------------------------------------------------------------------------------


def test_check_says_what_a_task_holds(task: str, headless: list, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = outcome(capsys, "check", task)
    assert (code, err) == (0, "")
    for words in ("Touch the card's corner", "wam7", "left, hand", "tip_on_corner_l", "2 rows hold 2 of 4"):
        assert words in out
    assert "turned by 180 degrees" in out, "the doctor's findings are missing"


def test_check_json_is_one_object_a_line(
    task: str, headless: list, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = outcome(capsys, "check", "--json", task, task)
    rows = [json.loads(line) for line in out.splitlines()]
    assert code == 0 and [row["scenario"] for row in rows] == [task, task]
    assert rows[0]["findings"] == ["second_solution"] and rows[0]["robot"] == "wam7"


def test_check_goes_on_after_a_bad_file(
    task: str, headless: list, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoiled = tmp_path / "spoiled.toml"
    spoiled.write_text(TASK.replace("fov_deg = 50", "fov_deg = 500"))
    code, out, err = outcome(capsys, "check", str(spoiled), task)
    assert code == 2 and "Touch the card" in out
    assert err == f"vita: {spoiled}: camera[0].fov_deg: 500.0 is outside 1 to 170\n"


def test_list_has_a_row_for_every_shipped_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = outcome(capsys, "list")
    lines = out.splitlines()
    assert code == 0 and lines[0].split() == ["name", "robot", "title"]
    assert [line.split()[0] for line in lines[1:]] == list(shipped())


# serve -------------------------------------------------------------------------------------------


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """Replaces the page; returns the list of what it was asked to serve."""
    asked: list[tuple] = []
    module = ModuleType("vita.ui")

    def serve(scenario, host, port) -> None:
        asked.append((scenario.scene.robot, host, port))
        vars(module).update(scenario=scenario)
        if port == 1:
            raise OSError(13, "Permission denied")
        if port == 2:
            raise KeyboardInterrupt

    vars(module).update(serve=serve)
    monkeypatch.setitem(sys.modules, "vita.ui", module)
    return asked


@pytest.mark.parametrize(
    ("arguments", "host", "port"),
    [
        (["serve", "TASK"], "127.0.0.1", 8080),
        (["TASK"], "127.0.0.1", 8080),
        (["serve", "--port", "0", "TASK", "--host", "0.0.0.0"], "0.0.0.0", 0),
        (["--port", "9000", "TASK"], "127.0.0.1", 9000),
    ],
)
def test_serve(arguments: list[str], host: str, port: int, task: str, served: list) -> None:
    assert cli.main([task if word == "TASK" else word for word in arguments]) == 0
    assert served == [("wam7", host, port)]


@pytest.mark.parametrize(
    ("arguments", "robot"), [([], "wam7"), (["--robot", "wam7"], "wam7"), (["--robot", "wam4"], "wam4")]
)
def test_alone_it_serves_an_empty_task(arguments: list[str], robot: str, served: list) -> None:
    assert cli.main(arguments) == 0
    assert served[0][0] == robot
    shown = sys.modules["vita.ui"].scenario
    assert shown.camera and shown.scene.objects and not shown.tracker and not shown.constraint


def test_a_port_that_is_taken_is_a_clear_line(
    task: str, served: list, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = outcome(capsys, "serve", task, "--port", "1")
    assert code == 3 and "cannot listen on 127.0.0.1:1: Permission denied" in err


def test_ctrl_c_is_quiet(task: str, served: list, capsys: pytest.CaptureFixture[str]) -> None:
    assert outcome(capsys, "serve", task, "--port", "2") == (130, "", "")


# What can go wrong -------------------------------------------------------------------------------


def test_faults_lists_every_row_of_the_catalogue_and_how_to_go_on(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = outcome(capsys, "faults")
    assert (code, err) == (0, "")
    rows = {line.split()[0]: line for line in out.splitlines()[1:]}
    assert list(rows) == list(CATALOGUE)
    for name, row in CATALOGUE.items():
        assert all(words in rows[name] for words in (row.title, row.verdict, row.recover))
        assert rows[name].split()[-1] == ("yes" if name in injectors() else "-")


def replaced(monkeypatch: pytest.MonkeyPatch, name: str, **contents: Any) -> None:
    """Put another module in the place of one that a verb imports."""
    module = ModuleType(name)
    vars(module).update(contents)
    monkeypatch.setitem(sys.modules, name, module)


@pytest.fixture
def fuzzed(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """Replaces the fuzzers; returns the list of what they were asked. `frames` finds something."""
    asked: list[tuple] = []
    for name in ("gate", "files", "events", "frames"):

        def run(seconds: float, seed: int, name: str = name) -> Report:
            asked.append((name, seconds, seed))
            bad = tuple(f"frame {i} was taken" for i in range(12)) if name == "frames" else ()
            return Report(name, 1234, "things", bad, {"worst [ms]": 1.5})

        replaced(monkeypatch, f"vita.fuzz.{name}", run=run)
    return asked


def test_fuzz_runs_one_fuzzer_or_all_and_prints_a_line_for_each(
    fuzzed: list, capsys: pytest.CaptureFixture[str]
) -> None:
    assert outcome(capsys, "fuzz", "gate", "--seconds", "2.5", "--seed", "7") == (
        0, "ok   gate: 1234 things, 0 violations, worst [ms] 1.5\n", "",
    )  # fmt: skip
    assert fuzzed == [("gate", 2.5, 7)]
    for arguments in ((), ("all",)):
        fuzzed.clear()
        code, out, _ = outcome(capsys, "fuzz", *arguments)
        assert code == 1 and [name for name, *_ in fuzzed] == ["gate", "files", "events", "frames"]
    lines = out.splitlines()
    assert lines[3].startswith("FAIL frames: 1234 things, 12 violations") and len(lines) == 4 + 10 + 1
    assert lines[4].strip() == "frame 0 was taken" and lines[-1].strip() == "and 2 more"


def test_a_fuzzer_that_tried_nothing_has_not_passed() -> None:
    assert not Report("gate", 0, "cycles").passed and Report("gate", 1, "cycles").passed


@pytest.mark.parametrize(
    "arguments",
    [
        ["fuzz", "gates"], ["fuzz", "--seconds", "0"], ["fuzz", "--seconds", "-1"], ["fuzz", "--seed", "x"],
        ["fuzz", "--seconds", "nan"], ["soak", "--minutes", "inf"], ["soak", "extra"],
        ["stop", "--port", "x"], ["replay"], ["faults", "V5"],
    ],
)  # fmt: skip
def test_nothing_is_tried_on_a_callers_mistake(
    arguments: list[str], fuzzed: list, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = outcome(capsys, *arguments)
    assert code == 2 and out == "" and "vita" in err and not fuzzed


def test_soak_passes_on_what_it_is_asked_and_its_verdict_is_the_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []

    def run(seconds: float, seed: int, *, out: Path | None) -> Report:
        asked.append((seconds, seed, out))
        return Report("soak", 9, "actions", ("memory grew by 99.0 MB",) if seed else ())

    replaced(monkeypatch, "vita.fuzz.soak", run=run)
    folder = tmp_path / "new"
    assert outcome(capsys, "soak", "--minutes", "0.5", "--out", str(folder))[0] == 0 and folder.is_dir()
    code, out, _ = outcome(capsys, "soak", "--seed", "4")
    assert code == 1 and "memory grew by 99.0 MB" in out
    assert asked == [(30.0, 0, folder), (900.0, 4, None)]


def test_stop_reaches_the_app_of_a_port_and_replay_a_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple] = []
    replaced(monkeypatch, "vita.stopping", stop=lambda port, emergency: asked.append((port, emergency)) or 1)
    assert cli.main(["stop"]) == 1 and cli.main(["stop", "--port", "9000", "--emergency"]) == 1
    assert asked == [(None, False), (9000, True)]
    told = lambda path, **given: asked.append((path, given)) or 2  # noqa: E731
    replaced(monkeypatch, "vita.scenario.replay", replay=told)
    assert cli.main(["replay", "x.npz", "--json", "--out", "o"]) == 2
    assert asked[2:] == [(Path("x.npz"), {"out": Path("o"), "as_json": True})]


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        ([], {}),
        (["--allow-remote", "--token", "secret"], {"allow_remote": True, "token": "secret"}),
        (["--allow-unattended"], {"allow_unattended": True}),
    ],
)
def test_serve_passes_on_the_permissions_that_were_given(
    arguments: list[str], options: dict[str, object], task: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, object]] = []
    replaced(monkeypatch, "vita.ui", serve=lambda scenario, host, port, **given: asked.append(given))
    assert cli.main(["serve", task, *arguments]) == 0 and asked == [options]


# As a process ------------------------------------------------------------------------------------


def process(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    root = str(Path(vita.__file__).parent.parent)
    environment = os.environ | {"PYTHONPATH": root} | dict(options.pop("env", {}))  # type: ignore[call-overload]
    command = [sys.executable, "-m", "vita", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, **options)  # type: ignore[call-overload]


def test_list_and_bad_files_need_neither_page_nor_simulator(tmp_path: Path) -> None:
    """Both would add seconds to every command."""
    code = (
        "import sys; from vita.cli import main; main(['list']); main(['check', 'no.toml']); "
        "print([m for m in ('viser', 'pybullet', 'matplotlib') if m in sys.modules])"
    )
    root = str(Path(vita.__file__).parent.parent)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | {"PYTHONPATH": root}
    )
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_a_process_ends_with_the_exit_code_and_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_bytes(TASK.encode("utf-16"))
    done = process("check", "bad.toml", cwd=tmp_path)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr == "vita: bad.toml: line 1: the file is UTF-16; save it as UTF-8\n"


def test_a_terminal_without_unicode_still_gets_its_answer() -> None:
    done = process("list", env={"PYTHONIOENCODING": "ascii", "LC_ALL": "C"})
    assert done.returncode == 0 and done.stdout.startswith("name")


def test_a_reader_that_goes_away_is_no_error() -> None:
    """As in `vita list | head -1`, with the reader gone from the start."""
    read, write = os.pipe()
    os.close(read)
    root = str(Path(vita.__file__).parent.parent)
    done = subprocess.run(
        [sys.executable, "-m", "vita", "list"],
        stdout=write, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": root},
    )  # fmt: skip
    os.close(write)
    assert done.returncode == 0 and done.stderr == ""


def test_a_shipped_scenario_runs_the_same_twice(tmp_path: Path) -> None:
    """The whole way: process, simulator, JSON, recording."""
    lines = []
    for folder in ("a", "b"):
        done = process("run", "point_to_point_wam4", "--json", "--out", str(tmp_path / folder))
        assert done.returncode == 0, done.stderr
        lines.append(done.stdout)
    assert lines[0] == lines[1] and json.loads(lines[0])["passed"]
    assert RunRecord.load(tmp_path / "a" / "point_to_point_wam4").outcome == "converged"


# The README and CI -------------------------------------------------------------------------------


def test_the_readme_has_the_two_marked_commands_on_one_line_each() -> None:
    """`.ci/run` takes its test command from there."""
    readme = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    tests = " && .venv/bin/pytest -n 2 -m 'not alone' && .venv/bin/pytest -m alone"
    for mark, end in (("app", " && .venv/bin/vita"), ("test", tests)):
        block = readme.partition(f"<!-- command: {mark} -->")[2].partition("```")[2].partition("```")[0]
        (_, line, _) = block.split("\n")
        assert line.startswith("python3 -m venv .venv && .venv/bin/pip install") and line.endswith(end)
