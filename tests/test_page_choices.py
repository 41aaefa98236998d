"""The dropdowns and settings of the servo, without a browser."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from browser import wait_for
from fake_runner import FakeRunner

from vita import commands as c
from vita.servo.config import ServoConfig
from vita.servo.estimators import ESTIMATORS, Tuning, first_estimate
from vita.servo.policies import POLICIES, Situation
from vita.servo.secondary import SECONDARIES
from vita.snapshot import Snapshot
from vita.ui import App
from vita.ui.panels.servo import GROUPS, UNUSED, ServoPanel, applies


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    runner = FakeRunner()
    app = App(runner, port=0)
    app.commands.lease.opened(0)
    try:
        yield app
    finally:
        app.close()
        runner.close()


@pytest.fixture
def panel(app: App) -> ServoPanel:
    app.runner.log.clear()  # type: ignore[attr-defined]
    app.runner.submit(c.SetServo("estimator", "kalman"))
    app.runner.submit(c.SetServo("policy", "uncertainty"))
    panel = next(p for p in app.panels if isinstance(p, ServoPanel))
    wait_for(lambda: len(app.runner.log) == 2, "the usual method")  # type: ignore[attr-defined]
    panel.update(after(app))
    return panel


def after(app: App) -> Snapshot:
    """A snapshot of two ticks later, in which everything that was asked is done."""
    tick = app.runner.snapshot().tick
    wait_for(lambda: app.runner.snapshot().tick > tick + 1, "another snapshot")
    return app.runner.snapshot()


def choose(panel: ServoPanel, field: str, title: object) -> list[str]:
    """As if a browser had chosen `title`; returns what it is told in return."""
    told: list[str] = []
    client = SimpleNamespace(client_id=0, add_notification=lambda title, text, **how: told.append(text))
    for callback in panel._choices[field].handle._impl.update_cb:
        event = SimpleNamespace(client=client, client_id=0, target=SimpleNamespace(value=title))
        asyncio.run(callback(event))  # type: ignore[arg-type]
    return told


@pytest.mark.parametrize(
    ("field", "registry"), [("estimator", ESTIMATORS), ("policy", POLICIES), ("secondary", SECONDARIES)]
)
def test_a_dropdown_offers_every_registered_kind_and_sends_the_one_chosen(
    app: App, panel: ServoPanel, field: str, registry: dict[str, type]
) -> None:
    handle = panel._choices[field].handle
    assert list(handle.options) == [kind.title for kind in registry.values()]  # type: ignore[attr-defined]
    sent: list[object] = app.runner.log  # type: ignore[attr-defined]
    for name, kind in registry.items():
        sent.clear()
        choose(panel, field, kind.title)  # type: ignore[attr-defined]
        wait_for(lambda: sent, "the command")
        assert sent == [c.SetServo(field, name)]
        panel.update(after(app))
        assert handle.value == kind.title  # type: ignore[attr-defined]
        assert kind.doc[:20] in panel._choices[field]._about._handle.content  # type: ignore[attr-defined]


def test_a_dropdown_follows_what_a_script_or_another_browser_set(app: App, panel: ServoPanel) -> None:
    app.runner.submit(c.SetServo("estimator", "rls"))
    panel.update(after(app))
    assert panel._choices["estimator"].handle.value == ESTIMATORS["rls"].title


@pytest.mark.parametrize("value", ["kalman", "no such", "", 7, None, ["Kalman filter"], "<b>"])
def test_an_option_that_is_none_is_refused(app: App, panel: ServoPanel, value: object) -> None:
    """A browser may send anything; only titles that are offered become commands."""
    app.runner.log.clear()  # type: ignore[attr-defined]
    (told,) = choose(panel, "estimator", value)
    assert ESTIMATORS["kalman"].title in told  # the choices are named
    assert after(app).scenario.servo.estimator == "kalman"
    assert not app.runner.log  # type: ignore[attr-defined]


def test_a_command_with_an_unknown_kind_changes_nothing(app: App, panel: ServoPanel) -> None:
    app.runner.submit(c.SetServo("estimator", "no such"))
    snapshot = after(app)
    assert snapshot.scenario.servo.estimator == "kalman"
    assert "kalman" in snapshot.notices[-1].text


def test_settings_that_the_method_does_not_use_are_hidden_and_keep_their_values(
    app: App, panel: ServoPanel
) -> None:
    alpha = panel._inputs["servo", "alpha"]
    assert not alpha.visible
    for command in (c.SetServo("estimator", "broyden"), c.SetServo("alpha", 0.7)):
        app.runner.submit(command)
    panel.update(after(app))
    assert alpha.visible and alpha.value == 0.7
    app.runner.submit(c.SetServo("estimator", "kalman"))
    snapshot = after(app)
    panel.update(snapshot)
    assert not alpha.visible and snapshot.scenario.servo.alpha == 0.7


def test_every_setting_has_its_place_on_the_tab(panel: ServoPanel) -> None:
    shown = {name for group, name in panel._inputs if group == "servo"} | set(panel._choices)
    assert shown == {f.name for f in fields(ServoConfig) if f.metadata}
    assert {name for names in GROUPS.values() for name in names} <= shown


class _Run:
    """A short run with curvature and noise on which tuning could make a difference."""

    def __init__(self) -> None:
        rng = np.random.default_rng(5)
        self.jacobian = rng.normal(0, 300, (4, 3))
        self.q = np.cumsum(rng.normal(0, 0.05, (30, 3)), axis=0)
        self.e = self.q @ self.jacobian.T + 200 * self.q**2 @ np.ones((3, 4)) + rng.normal(0, 0.2, (30, 4))


@pytest.mark.parametrize("setting", ["alpha", "forgetting"])
@pytest.mark.parametrize("kind", ESTIMATORS)
def test_a_setting_is_hidden_exactly_for_the_estimators_that_it_does_not_change(
    kind: str, setting: str
) -> None:
    run, found = _Run(), []
    for value in (0.6, 0.9):
        start = first_estimate(run.jacobian, 0.07, 0.3)
        estimator = ESTIMATORS[kind](start, None, Tuning(**{setting: value}))
        for q, e in zip(run.q, run.e, strict=True):
            estimator.observe(q, e)
        found.append(estimator.jacobian)
    assert (not np.array_equal(*found)) == applies(setting, ServoConfig(estimator=kind))


@pytest.mark.parametrize("kind", POLICIES)
def test_damping_is_hidden_exactly_for_the_policies_that_it_does_not_change(kind: str) -> None:
    run, found = _Run(), []
    for value in (0.01, 0.3):
        estimate, policy = first_estimate(run.jacobian, 0.07, 0.3), POLICIES[kind]()
        free = np.ones(3, bool)
        found.append(policy.step(Situation(run.q[0], 300 + run.e[0], estimate, free, damping=value)).dq)
    assert (not np.array_equal(*found)) == applies("damping", ServoConfig(policy=kind))


def test_the_table_of_unused_settings_names_kinds_that_exist() -> None:
    registries = {"estimator": ESTIMATORS, "policy": POLICIES, "secondary": SECONDARIES}
    for choice, kinds in UNUSED.values():
        assert set(kinds) <= set(registries[choice])
