"""Which tests want the machine for themselves, and how to run those of one row of the fault catalogue."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

ALONE = (
    "test_fuzz_frames",
    "test_live_rig",
    "test_page_addresses_browser",
    "test_page_browser",
    "test_page_choices",
    "test_page_impedance_browser",
    "test_page_knowledge_browser",
    "test_page_lens",
    "test_page_real",
    "test_page_safety_browser",
    "test_page_trackers_browser",
    "test_process_rows",
    "test_runner",
    "test_state_rows_live",
    "test_soak",
    "test_track_stop",
    "test_web_rows",
)
"""They run in real time or draw in a browser: beside others they would measure the machine."""


@pytest.fixture(autouse=True, scope="session")
def own_data_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No test writes into the folder of whoever runs it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VITA_DATA", str(tmp_path_factory.mktemp("data")))
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--row", metavar="V5", help="only the tests of one row of the fault catalogue")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    row = config.getoption("--row")
    if row:
        others = [i for i in items if all(mark.args[0] != row for mark in i.iter_markers("fault"))]
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if item not in others]
    for item in items:
        if item.path.stem in ALONE:
            item.add_marker(pytest.mark.alone)
