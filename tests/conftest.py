"""Which tests want the machine for themselves."""

from __future__ import annotations

import pytest

ALONE = (
    "test_live_rig",
    "test_page_browser",
    "test_page_choices",
    "test_page_impedance_browser",
    "test_page_knowledge_browser",
    "test_page_lens",
    "test_page_real",
    "test_page_trackers_browser",
    "test_runner",
    "test_track_stop",
)
"""They run in real time or draw in a browser: beside others they would measure the machine."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.stem in ALONE:
            item.add_marker(pytest.mark.alone)
