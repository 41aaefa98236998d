"""The door of the page, piece by piece: who comes in, what passes, and that vita notices when it fails.

What it does to whole faults is in `faults/test_web_rows.py`.
"""

from __future__ import annotations

import ast
import inspect
import math
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fake_runner import FakeRunner, two_cameras
from hypothesis import given
from hypothesis import strategies as st
from viser import _messages
from websockets.datastructures import Headers
from websockets.http11 import Request

import vita.ui
from vita.errors import BadInput, MissingDependency
from vita.fuzz.client import CAMERA, Client, TurnedAway
from vita.fuzz.knock import knock
from vita.fuzz.malformed import MALFORMED, injections, pack
from vita.ui import App, connection, entrance, hardening, ports, selfcheck, serve, wire
from vita.ui.selfcheck import ATTACKS, Unprotected
from vita.ui.throttle import BURST, HELD_MAX, RATE, STOP_BURST, STOP_RATE, Bucket, Seldom, Valve

TOKEN = "correct-horse-battery"


# What may be said.


@pytest.mark.parametrize("name", MALFORMED)
def test_what_no_page_sends_is_refused_with_a_reason(name: str) -> None:
    with pytest.raises(wire.Refused) as refusal:
        wire.read(MALFORMED[name])
    assert refusal.value.code in (1007, 1008) and refusal.value.reason


@pytest.mark.parametrize("name", injections("x"))
def test_of_a_widget_only_its_value_can_be_set(name: str) -> None:
    with pytest.raises(wire.Refused) as refusal:
        wire.read(injections("x")[name])
    assert refusal.value.code == 1008


@given(st.binary(max_size=200) | st.text(max_size=20))
def test_no_frame_makes_the_reader_fail_otherwise_than_by_refusing(raw: bytes | str) -> None:
    try:
        wire.read(raw)
    except wire.Refused as refusal:
        assert refusal.code in (1007, 1008)


ATOMS = st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | st.text(max_size=5)
ANYTHING = st.recursive(
    ATOMS | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)
SAID = st.tuples(st.sampled_from(["stop", "click", "value"]), st.integers(0, 3), st.floats(0, 0.02))


@given(ANYTHING, st.sampled_from(sorted(CAMERA)))
def test_viser_reads_what_was_checked_and_nothing_else(value: Any, field: str) -> None:
    """Whatever stands in a field: it is refused, or viser decodes it to finite numbers of the right count."""
    try:
        message = wire.read(pack({**CAMERA, field: value}))
    except wire.Refused:
        return
    seen = _messages.Message.deserialize(wire.pack(message))
    assert isinstance(seen, _messages.ViewerCameraMessage)
    assert len(seen.wxyz) == 4 and len(seen.position) == len(seen.look_at) == len(seen.up_direction) == 3
    numbers = [*seen.wxyz, *seen.position, *seen.look_at, *seen.up_direction, seen.fov, seen.near, seen.far]
    assert all(math.isfinite(x) for x in numbers)


def test_a_key_that_stands_twice_means_to_viser_what_it_means_to_us() -> None:
    camera = pack(CAMERA)
    count = camera[0] & 0x0F
    twice = bytes([0x80 | (count + 1)]) + camera[1:] + pack("type") + pack("ShareUrlRequest")
    try:
        message = wire.read(twice)
    except wire.Refused:
        return
    assert type(_messages.Message.deserialize(wire.pack(message))).__name__ == type(message).__name__


def test_every_message_is_one_of_visers_with_the_same_fields() -> None:
    for kind in wire.Message.__subclasses__():
        fields = {f.name for f in msgspec.structs.fields(kind)}
        theirs = getattr(_messages, kind.__name__)
        assert fields == set(inspect.signature(theirs).parameters), kind.__name__


# How much may be said.


def test_a_bucket_gives_its_burst_and_then_its_rate() -> None:
    bucket = Bucket(rate=10.0, burst=5.0)
    taken = sum(bucket.take(now=i / 1000) for i in range(2000))
    assert taken == 5 + 19 or taken == 5 + 20
    assert not bucket.take(2.0) and 0 < bucket.wait_s(2.0) <= 0.1


@given(st.lists(SAID, max_size=2000))
def test_a_valve_never_lets_more_through_and_never_loses_the_last_value_or_a_stop(said) -> None:
    valve: Valve[tuple[str, int, int]] = Valve()
    now, passed, last = 0.0, [], {}
    for number, (kind, key, pause) in enumerate(said):
        now += pause
        message = (kind, key, number)
        if kind != "click":
            last[kind, key] = message
        out = valve.offer((kind, key), message, kind, now)
        passed += [] if out is None else [out]
    spent = now
    while (wait := valve.wait_s(now)) is not None:
        now += wait + 1e-6
        out = valve.due(now)
        passed += [] if out is None else [out]
    assert not valve.full
    assert sum(kind != "stop" for kind, _, _ in passed) <= BURST + RATE * now + 1
    assert sum(kind == "stop" for kind, _, _ in passed) <= STOP_BURST + STOP_RATE * now + 1
    newest = {(kind, key): number for kind, key, number in passed}
    assert all(newest[what] == message[2] for what, message in last.items()), "the newest value comes through"
    assert now - spent < 4 * 4 / STOP_RATE, "and soon"


def test_a_drag_and_a_camera_in_motion_are_never_held() -> None:
    """60 camera messages, 60 of a drag, 15 answers a second: more than the rate, for three seconds."""
    valve: Valve[int] = Valve()
    for i in range(3 * 135):
        assert valve.offer(("drag", i % 3), i, "value", now=i / 135.0) == i


def test_a_stop_passes_when_everything_else_is_used_up() -> None:
    valve: Valve[str] = Valve()
    for _ in range(1000):
        valve.offer("button", "click", "click", now=0.0)
    assert valve.dropped > 500
    assert valve.offer("stop", "stop", "stop", now=0.0) == "stop"
    for i in range(100):
        valve.offer(("x", i), "value", "value", now=0.0)
    assert valve.full and len(valve._held) >= HELD_MAX
    assert valve.offer("emergency", "emergency", "stop", now=0.0) == "emergency"


def test_an_emergency_stop_is_not_replaced_by_a_stop() -> None:
    valve: Valve[str] = Valve()
    for _ in range(10):
        valve.offer("stop", "stop", "stop", now=0.0)
    valve.offer("estop", "estop", "stop", now=0.0)
    valve.offer("stop", "stop", "stop", now=0.0)
    assert {valve.due(1.0), valve.due(2.0)} == {"stop", "estop"}


def test_the_log_says_a_thing_once_a_second_and_how_often_it_was() -> None:
    seldom = Seldom()
    assert seldom("flood", 0.0) == ""
    assert [seldom("flood", t / 10) for t in range(1, 10)] == [None] * 9
    assert seldom("other", 0.5) == ""
    assert seldom("flood", 1.0) == " (and 9 more like it)"


# Who may come in.


def asked(path: str = "/", **headers: str) -> Request:
    return Request(path, Headers({name.replace("_", "-"): value for name, value in headers.items()}))


class Standing(entrance.Door):
    """A door whose page stands, without a server."""

    server: Any = None

    def __init__(self, host: str = "127.0.0.1", token: str | None = None) -> None:
        super().__init__(host, 8080, token)

    def status(self, path: str = "/", **headers: str) -> int | None:
        response = self.refusal(asked(path, **headers))
        return None if response is None else response.status_code


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "LOCALHOST:8080"])
def test_the_pages_own_names_come_in(host: str) -> None:
    assert Standing().status(Host=host) is None
    assert Standing().status(Host=host, Origin=f"http://{host}") is None


@pytest.mark.parametrize(
    "host", ["evil.example:8080", "127.0.0.1", "127.0.0.1:80", "localhost.evil:8080", "", "[::]:8080"]
)
def test_other_names_do_not(host: str) -> None:
    assert Standing().status(Host=host) == 421


def test_two_hosts_or_none_are_no_host() -> None:
    two = Headers([("Host", "127.0.0.1:8080"), ("Host", "127.0.0.1:8080")])
    assert Standing().refusal(Request("/", two)).status_code == 421  # type: ignore[union-attr]
    assert Standing().status() == 421


@pytest.mark.parametrize(
    "origin", ["http://localhost:8080", "https://127.0.0.1:8080", "null", "http://127.0.0.1:8080/"]
)
def test_the_origin_is_that_of_the_host_to_the_letter(origin: str) -> None:
    assert Standing().status(Host="127.0.0.1:8080", Origin=origin) == 403


def test_nothing_without_the_token_but_403() -> None:
    door = Standing("192.168.7.7", TOKEN)
    there = {"Host": "192.168.7.7:8080"}
    assert door.status(**there) == 403
    assert door.status("/?token=wrong", **there) == 403
    assert door.status(f"/?token={TOKEN}&token={TOKEN}", **there) == 403
    assert door.status(**there, Cookie=f"vita_8080={TOKEN}x") == 403
    assert door.status(**there, Cookie=f"other={TOKEN}") == 403
    assert door.status(**there, Cookie=f"a=b; vita_8080={TOKEN}") is None
    assert door.status("/?token=wrong", **there, Cookie=f"vita_8080={TOKEN}") == 403


def test_the_token_goes_into_a_cookie_and_out_of_the_address() -> None:
    door = Standing("192.168.7.7", TOKEN)
    response = door.refusal(asked(f"/?token={TOKEN}&fixedDpr=1", Host="192.168.7.7:8080"))
    assert response is not None and response.status_code == 303
    assert response.headers["Location"] == "/?fixedDpr=1"
    cookie = response.headers["Set-Cookie"]
    assert cookie.startswith(f"vita_8080={TOKEN};") and "HttpOnly" in cookie and "SameSite=Lax" in cookie


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.7.7", "example.org"])
def test_a_host_that_others_reach_needs_to_be_allowed(host: str) -> None:
    def never(scenario: object) -> Any:
        pytest.fail("the simulation was started")

    with pytest.raises(BadInput, match="--allow-remote"):
        serve(two_cameras(), host, 0, make_runner=never)
    with pytest.raises(BadInput, match="--allow-remote"):
        hardening.open_page(host, 0)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.9.9.9"])
def test_this_machine_needs_not(host: str) -> None:
    ports.check_reach(host, allow_remote=False)


@pytest.mark.parametrize("token", ["", "short", "x" * 200, "with space in it...", "semi;colon;semi;colon"])
def test_a_token_that_can_be_guessed_or_breaks_a_cookie_is_refused(token: str) -> None:
    with pytest.raises(BadInput, match="--token"):
        hardening.open_page("127.0.0.1", 0, token=token)
    with pytest.raises(BadInput, match="--token"):
        serve(two_cameras(), port=0, token=token, make_runner=lambda scenario: pytest.fail("it was started"))


def test_the_token_that_is_made_is_long_and_new_each_time() -> None:
    tokens = set()
    for _ in range(2):
        server, door = hardening.open_page("0.0.0.0", 0, allow_remote=True)
        server.stop()
        assert door.token and len(door.token) >= 32 and door.address.endswith(f"/?token={door.token}")
        tokens.add(door.token)
    assert len(tokens) == 2


# The page as a whole.


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    runner = FakeRunner()
    made = App(runner, port=0)
    yield made
    made.close()
    runner.close()


@pytest.fixture(scope="module")
def remote() -> Iterator[App]:
    runner = FakeRunner()
    made = App(runner, "0.0.0.0", 0, allow_remote=True, token=TOKEN)
    yield made
    made.close()
    runner.close()


def reached(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError:
        return False
    return True


def _has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as probe:
            probe.bind(("::1", 0))
        return True
    except OSError:
        return False


def test_it_listens_on_this_machine_only(app: App, remote: App) -> None:
    outside = ports.local_address()
    assert reached("127.0.0.1", app.port)
    if _has_ipv6():
        assert reached("::1", app.port), "some browsers go there for localhost"
    if not ports.is_here(outside):
        assert not reached(outside, app.port)
        assert reached(outside, remote.port), "the probe itself works"


def test_pages_are_told_to_load_nothing_from_elsewhere_and_to_be_framed_by_nobody(app: App) -> None:
    for path in ("/", "/nothing-here"):
        with knock(app.door.own_address, path) as answer:
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert answer.headers["referrer-policy"] == "no-referrer"
            assert answer.headers["x-frame-options"] == "DENY"
            assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
            assert "server" not in answer.headers


def test_pings_go_out_every_second(app: App) -> None:
    assert connection.PING_S + connection.PONG_S + 0.05 <= 2.5


def test_with_a_token_pages_without_it_do_not_come_in(remote: App) -> None:
    with pytest.raises(TurnedAway) as refusal:
        Client(remote.door.own_address)
    assert refusal.value.status == 403
    with Client(remote.door.own_address, headers=remote.door.badge) as page:
        assert page.has("Stop")


def test_the_self_check_passes_and_is_quick(app: App, remote: App, caplog) -> None:
    for page in (app, remote):
        caplog.clear()
        took = min(selfcheck.check(page.door) for _ in range(3))
        assert took < 1.5
        assert not caplog.records, "nobody needs to read of our own attacks"


BREAKS: dict[str, Any] = {
    "a page of another site came in": lambda m: m.setattr(
        entrance.Door, "refusal", _without_origins(entrance.Door.refusal)
    ),
    "a page without a site came in": lambda m: m.setattr(
        entrance.Door, "refusal", _without_origins(entrance.Door.refusal, only="null")
    ),
    "a program without an Origin came in": lambda m: m.setattr(
        entrance.Door, "refusal_of_page", lambda self, request: None
    ),
    "a foreign Host was answered": lambda m: m.setattr(
        entrance, "names_of", lambda host, port: ports.names_of(host, port) | {f"evil.example:{port}"}
    ),
    "somebody came in without the token": lambda m: m.setattr(entrance, "same", lambda given, token: True),
    "a file outside the page was read": lambda m: m.setattr(entrance.Door, "answer", _everything),
    "a page could ask for a public address": lambda m: (
        m.setattr(connection.Connection, "_admit", _sharing), m.setattr(hardening, "UNWANTED", ())
    ),
    "a page could disable the Stop button": lambda m: m.setattr(wire, "read", _lenient(wire.read)),
    "a malformed frame was swallowed": lambda m: m.setattr(wire, "read", _swallowing(wire.read)),
    "a value that no slider has was taken": lambda m: m.setattr(
        connection, "accept", lambda handle, value: None
    ),
    "more pages came in than allowed": lambda m: m.setattr(entrance, "PAGES_MAX", 99),
}


def _without_origins(real: Any, only: str | None = None) -> Any:
    def refusal(self: Any, request: Request) -> Any:
        headers = Headers(
            (k, v) for k, v in request.headers.raw_items()
            if k.lower() != "origin" or (only is not None and v != only)
        )  # fmt: skip
        return real(self, Request(request.path, headers))

    return refusal


def _everything(self: Any, caller: Any, request: Request, inner: Any) -> Any:
    """As a file server that goes where the path leads."""
    response = REAL_ANSWER(self, caller, request, inner)
    if response is not None and response.status_code == 404:
        response.status_code = 200
    return response


REAL_ANSWER = entrance.Door.answer


def _sharing(self: Any, raw: Any) -> Any:
    return wire.read(raw)


def _lenient(real: Any) -> Any:
    def read(raw: Any) -> Any:
        try:
            return real(raw)
        except wire.Refused as refusal:
            if "updates" in refusal.reason:
                return wire.ShareUrlDisconnect()
            raise

    return read


def _swallowing(real: Any) -> Any:
    def read(raw: Any) -> Any:
        try:
            return real(raw)
        except wire.Refused as refusal:
            if refusal.code == wire.BAD_DATA:
                return wire.ShareUrlDisconnect()
            raise

    return read


def test_every_attack_has_a_way_to_let_it_succeed() -> None:
    assert set(BREAKS) == set(ATTACKS)


@pytest.mark.parametrize("attack", ATTACKS)
def test_the_self_check_finds_each_protection_that_is_broken(attack: str, monkeypatch) -> None:
    BREAKS[attack](monkeypatch)
    monkeypatch.setattr(selfcheck, "REACTION_S", 0.5)
    token = TOKEN if "token" in attack else None
    runner = FakeRunner()
    try:
        app = App(runner, port=0, token=token)
        try:
            with pytest.raises(Unprotected) as refusal:
                selfcheck.check(app.door)
        finally:
            app.close()
    finally:
        runner.close()
    assert refusal.value.attack == attack and refusal.value.exit_code == 3


def test_a_page_that_is_not_safe_is_not_served(monkeypatch, capsys) -> None:
    monkeypatch.setattr(connection, "accept", lambda handle, value: None)
    runner = FakeRunner()

    def never(app: App) -> None:
        pytest.fail("the address was given")

    with pytest.raises(Unprotected, match="a value that no slider has"):
        serve(runner.scenario, port=0, make_runner=lambda scenario: runner, ready=never)
    assert "vita is at" not in capsys.readouterr().out
    assert runner.stops > 0 and runner._closing


def test_a_viser_that_makes_its_server_otherwise_is_noticed(monkeypatch) -> None:
    """The wrapper sits on a name inside viser's code; were it unused, nothing would be protected."""
    import websockets.asyncio.server as theirs

    class Elsewhere(hardening.Server):
        def __call__(self, handler: Any, *args: Any, **more: Any) -> Any:
            return hardening.REAL(handler, *args, **more)

    monkeypatch.setattr(hardening, "Server", Elsewhere)
    with pytest.raises(MissingDependency, match="cannot be made safe"):
        hardening.open_page("127.0.0.1", 0)
    assert theirs.serve is hardening.REAL


def test_other_servers_of_this_process_are_left_alone() -> None:
    import websockets.asyncio.server as theirs

    assert theirs.serve is hardening.REAL
    server, _ = hardening.open_page("127.0.0.1", 0)
    server.stop()
    assert theirs.serve is hardening.REAL


# Callbacks.

PAGE = sorted(Path(vita.ui.__file__).parent.rglob("*.py"))
BLOCKING = {
    "sleep", "wait", "join", "acquire", "get_item", "get_render", "result", "recv", "urlopen", "connect",
    "run",
}  # fmt: skip


@pytest.mark.parametrize("path", PAGE, ids=lambda path: path.name)
def test_no_coroutine_of_the_page_blocks(path: Path) -> None:
    """They run on the loop that also carries Stop."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.AsyncFunctionDef):
            continue
        waited = {id(sub.value) for sub in ast.walk(node) if isinstance(sub, ast.Await)}
        for call in (sub for sub in ast.walk(node) if isinstance(sub, ast.Call)):
            name = getattr(call.func, "attr", getattr(call.func, "id", ""))
            where = f"{path.name}:{call.lineno}: {ast.unparse(call)}"
            assert name not in BLOCKING or id(call) in waited, where


def test_all_that_viser_calls_back_is_async(app: App) -> None:
    """Asked of a page that stands open: nothing of ours waits in viser's pool of threads."""
    with Client(app.door.own_address) as page:
        page.wait(lambda: app.boards and app.boards[max(app.boards)].layout is not None, "the board")
        client = app.server.get_clients()[max(app.boards)]
        for gui in (app.server.gui, client.gui):
            for handle in gui._gui_input_handle_from_uuid.values():
                for callback in handle._impl.update_cb:
                    assert inspect.iscoroutinefunction(callback), getattr(handle, "label", handle)
        for command in app.server.gui._command_handle_from_uuid.values():
            for callback in command._impl.trigger_cb:
                assert inspect.iscoroutinefunction(callback), command.label
        nodes = client.scene._handle_from_node_name.values()
        clicked = [entry.callback for node in nodes for entry in node._impl.click_cb]
        dragged = [entry.callback for node in nodes for entry in node._impl.drag_cb]
        assert clicked and dragged
        for callback in (*clicked, *dragged):
            assert inspect.iscoroutinefunction(callback)


def test_stop_passes_every_flood(app: App) -> None:
    """Buttons and keys that stop the arm are known to the door."""
    gui = app.server.gui
    buttons = {w.label for u, w in gui._gui_input_handle_from_uuid.items() if u in app.door.urgent}
    keys = {k.label for u, k in gui._command_handle_from_uuid.items() if u in app.door.urgent}
    assert buttons == {"Stop", "Emergency stop"}
    assert keys == {"Emergency stop", "Cancel, or stop the arm"}
