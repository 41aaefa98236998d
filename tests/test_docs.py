"""What the documents show runs as it stands."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def python_blocks() -> list[tuple[str, str]]:
    return [
        (f"{page.name}:{number}", code)
        for page in PAGES
        for number, code in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.S))
    ]


BLOCKS = python_blocks()


@pytest.mark.parametrize("code", [code for _, code in BLOCKS], ids=[name for name, _ in BLOCKS])
def test_every_python_example_runs_and_says_converged(code: str, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, "example", "exec"), {"__name__": "example"})
    assert "converged" in out.getvalue()


def test_the_robot_in_the_servo_page_is_twenty_lines() -> None:
    code = next(code for name, code in BLOCKS if name.startswith("servo.md"))
    assert len([line for line in code.splitlines() if line.strip()]) <= 22


def test_the_catalogue_of_faults_is_in_its_page_word_for_word() -> None:
    from vita.faults import CATALOGUE

    text = (ROOT / "docs" / "safety.md").read_text()
    for row in CATALOGUE.values():
        cells = (f"`{row.id}`", row.title, row.verdict, row.bound or "-", row.recover)
        assert f"| {' | '.join(cells)} |" in text, row.id


def test_links_and_pictures_of_the_documents_exist() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_the_settings_table_names_every_setting_with_its_default() -> None:
    from dataclasses import fields

    from vita.servo import ServoConfig

    text = (ROOT / "docs" / "servo.md").read_text()
    for f in fields(ServoConfig):
        default = {"joints": "all", "posture_deg": "start"}.get(f.name, f.default)
        if not isinstance(default, str):
            default = f"{default:g}"
        assert f"| `{f.name}` | {default} |" in text, f.name


def test_every_setting_of_the_second_mode_is_in_its_page_with_its_default() -> None:
    from dataclasses import fields

    from vita.impedance.config import ImpedanceConfig

    text = (ROOT / "docs" / "impedance.md").read_text()
    for f in fields(ImpedanceConfig):
        row = next((line for line in text.splitlines() if line.startswith(f"| `{f.name}` |")), "")
        assert row, f.name
        if isinstance(f.default, float):
            assert row.split("|")[2].split()[0] == f"{f.default:g}", f.name


def test_every_reason_is_in_the_pages_of_the_modes_or_of_safety() -> None:
    from vita.servo import REASONS

    pages = ("servo.md", "impedance.md", "safety.md")
    text = "".join((ROOT / "docs" / name).read_text() for name in pages)
    rig_only = {"", "rig_offline"}
    assert [r for r in REASONS if r not in rig_only and f"`{r}`" not in text] == []
