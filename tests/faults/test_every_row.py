"""The catalogue is whole, and every row of it is proven by a test."""

from __future__ import annotations

import re
from pathlib import Path

from vita.faults import CATALOGUE, injectors

COUNTS = {"V": 13, "T": 11, "C": 15, "R": 8, "U": 21, "P": 8, "Q": 4}


def test_the_catalogue_has_all_eighty_rows() -> None:
    names = [f"{group}{i}" for group, count in COUNTS.items() for i in range(1, count + 1)]
    assert list(CATALOGUE) == names and len(names) == 80


def test_every_row_is_the_subject_of_a_test() -> None:
    text = "".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    proven = set(re.findall(r'^@row\("(\w+)"\)$', text, re.MULTILINE))
    assert proven == set(CATALOGUE)


def test_injectors_are_of_rows() -> None:
    assert set(injectors()) <= set(CATALOGUE)
