"""The page's server, spoken to as no browser would."""

import contextlib
import http.client
import random
import socket
import struct
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

import msgspec
import viser
from pages import eventually
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import jssa_gym.viewer.server as guarded
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.viewer.choices import Choices, ShieldChoice
from jssa_gym.viewer.gate import LARGEST, Door, Speech
from jssa_gym.viewer.server import MOST_VISITORS, Server, listen

TOKEN = "a-token-of-twenty-ch"
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 1.0, 2.0],
    "fov": 0.7,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 400,
    "image_width": 600,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


def asked(port, path="/", **headers):
    """Status and headers of the answer to a request."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)
    with contextlib.closing(connection):
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()


@contextlib.contextmanager
def visitor(port, origin=None, **headers):
    """Somebody who came in as a page does, in viser's language."""
    with connect(
        f"ws://127.0.0.1:{port}/",
        origin=origin or f"http://127.0.0.1:{port}",
        subprotocols=[f"viser-v{viser.__version__}"],
        additional_headers=headers,
        max_size=None,
        open_timeout=30.0,
        close_timeout=1.0,
        ping_interval=None,  # a busy machine may take longer to answer
    ) as connection:
        connection.say = lambda message: connection.send(msgspec.msgpack.encode(message))
        connection.say(CAMERA)
        yield connection


def heard_out(connection):
    """Listen until nothing more is said."""
    while True:
        connection.recv(timeout=30.0)


@pytest.fixture
def server():
    made = Server(Door(), Speech(), listen("127.0.0.1", 0))
    yield made
    made.close()


def test_it_serves_viser_and_forbids_frames(server):
    status, headers, body = asked(server.port)
    assert status == 200
    assert b"<html" in body
    assert headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert headers["X-Frame-Options"] == "DENY"
    for path in ("/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/..\\..\\etc\\passwd", "/no_such_file"):
        assert asked(server.port, path)[0] == 404


def test_it_listens_at_the_loopback_address_alone(server):
    """As `ss -ltn` reads it: address and port of every socket that listens, in hexadecimal."""
    listening = []
    for table in ("tcp", "tcp6"):
        rows = [row.split() for row in Path("/proc/net", table).read_text().splitlines()[1:]]
        listening += [row[1] for row in rows if row[3] == "0A" and row[1].endswith(f":{server.port:04X}")]
    assert listening == [f"{struct.unpack('=I', socket.inet_aton('127.0.0.1'))[0]:08X}:{server.port:04X}"]


@pytest.mark.parametrize("host", ["evil.example", "192.168.0.7:8765", "localhost.evil.example"])
def test_forged_hosts_are_refused(server, host):
    assert asked(server.port, Host=host)[0] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://localhost"])
def test_forged_origins_are_refused(server, origin):
    with pytest.raises(InvalidStatus) as refused, visitor(server.port, origin):
        pass
    assert refused.value.response.status_code == 403
    assert asked(server.port, Origin=origin)[0] == 403
    assert server.wheel.visitors == []


def test_headers_that_are_there_twice_are_refused(server):
    with socket.create_connection(("127.0.0.1", server.port), timeout=30.0) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n")
        assert raw.recv(100).startswith(b"HTTP/1.1 400")


def test_with_a_token_nobody_comes_in_without_it():
    server = Server(Door(token=TOKEN), Speech(), listen("127.0.0.1", 0))
    try:
        assert server.address.endswith(f"/?token={TOKEN}")
        for path in ("/", "/index.html", "/?token=another-one-of-them"):
            status, _, body = asked(server.port, path)
            assert status == 401
            assert b"<html" not in body
        status, headers, _ = asked(server.port, f"/?token={TOKEN}")
        assert (status, headers["Location"]) == (303, "/")
        assert {"HttpOnly", "SameSite=Strict"} <= set(headers["Set-Cookie"].split("; "))
        cookie = headers["Set-Cookie"].split(";")[0]
        assert asked(server.port, Cookie=cookie)[0] == 200
        with pytest.raises(InvalidStatus) as refused, visitor(server.port):
            pass
        assert refused.value.response.status_code == 401
        with visitor(server.port, Cookie=cookie):
            eventually(lambda: server.wheel.visitors)
    finally:
        server.close()


def test_a_port_that_is_taken_is_said(server):
    with pytest.raises(ParameterError, match=f"port {server.port}"):
        listen("127.0.0.1", server.port)
    with pytest.raises(ParameterError, match="between 0 and 65535"):
        listen("127.0.0.1", 70000)


def test_a_viser_that_cannot_be_guarded_is_not_opened(monkeypatch):
    real = guarded.serving.serve

    class Otherwise(viser.ViserServer):
        """Serves as it likes."""

        def __init__(self, host, port, **others):
            with monkeypatch.context() as patch:
                patch.setattr(guarded.serving, "serve", real)
                super().__init__(host, 0, **others)

    monkeypatch.setattr(guarded.viser, "ViserServer", Otherwise)
    listening = listen("127.0.0.1", 0)
    with pytest.raises(InterfaceError, match="cannot be guarded"):
        Server(Door(), Speech(), listening)


def test_a_door_that_lets_everybody_in_is_noticed(monkeypatch):
    monkeypatch.setattr(Door, "refusal", lambda self, headers, websocket: "")
    listening = listen("127.0.0.1", 0)
    with pytest.raises(InterfaceError, match="lets in"):
        Server(Door(), Speech(), listening)


# ---- messages ------------------------------------------------------------------------------------------


def state_of(page):
    """All that a message could have changed."""
    snapshot, panel = page.runner.snapshot, page.panel
    values = {uuid: getattr(handle, "value", None) for uuid, handle in panel.entered.items()}
    return snapshot.choices, snapshot.paused, snapshot.factor, snapshot.clamped, snapshot.epoch, values, panel.layers


def uuid_of(page, switch):
    """By what a page calls a switch."""
    return next(uuid for uuid, handle in page.panel.entered.items() if handle is switch)


def malformed(page, count):
    """Messages that no page of ours sends: noise, broken ones, foreign ones, and ours with other values."""
    rng = random.Random(0)
    uuids = list(page.panel.entered)
    nodes = [*page.speech.nodes, "/arm0", "/nowhere"]
    values = (float("nan"), float("inf"), -1e308, 10**30, "x" * 1000, None, [], {}, [[1]], "none\x00", -1, "evil")
    pack = msgspec.msgpack.encode

    def any_of():
        value = rng.choice(values)
        value = str(value) if isinstance(value, int) and abs(value) > 2**62 else value
        kind = rng.randrange(8)
        if kind == 0:
            return rng.randbytes(rng.randrange(200))
        if kind == 1:
            return pack({"type": "GuiUpdateMessage", "uuid": rng.choice(uuids), "updates": {"value": value}})
        if kind == 2:
            attribute = rng.choice(["removed", "update_cb", "is_button", "__class__", "sync_cb", "gui_api"])
            return pack({"type": "GuiUpdateMessage", "uuid": rng.choice(uuids), "updates": {attribute: value}})
        if kind == 3:
            drag = {"type": "SceneNodeDragMessage", "phase": "start", "name": rng.choice(nodes), "instance_index": 0}
            return pack({**drag, "start_position": [0, 0, value], "end_position": [value, 0, 0], "owner": ""})
        if kind == 4:
            return pack({"type": rng.choice(["ShareUrlRequest", "ResetSceneMessage", "NoSuch", ""]), "x": value})
        if kind == 5:
            return pack(CAMERA)[: rng.randrange(1, 60)]
        if kind == 6:
            return pack({**CAMERA, rng.choice(list(CAMERA)): value})
        return "text, not bytes"

    return [any_of() for _ in range(count)]


@pytest.mark.long
def test_ten_thousand_malformed_messages_change_nothing(open_page, caplog):
    page = open_page(Choices(policy="reach-ppo", shields=(ShieldChoice("yield"),)))
    with visitor(page.server.port) as driver, visitor(page.server.port) as watcher:
        eventually(lambda: len(page.server.viser.get_clients()) == 2)
        eventually(lambda: page.speech.nodes, what="a person to drag")
        page.runner.submit(lambda session: setattr(session, "paused", True))
        eventually(lambda: page.runner.snapshot.paused)
        # the switches follow what is, a moment later
        eventually(lambda: page.panel.pause.value and page.panel.handles["human_speed"].value == 1.6)
        before, refused = state_of(page), page.server.refused
        messages = malformed(page, 10_000)
        for k, message in enumerate(messages):
            (driver if k % 2 else watcher).send(message)
        eventually(lambda: page.server.refused - refused == len(messages), what="an answer to all")
        assert state_of(page) == before
        # and they are still heard
        pause = uuid_of(page, page.panel.pause)
        driver.say({"type": "GuiUpdateMessage", "uuid": pause, "updates": {"value": False}})
        eventually(lambda: not page.runner.snapshot.paused)
    assert page.runner.failure is None
    assert [record for record in caplog.records if record.levelname in ("ERROR", "CRITICAL")] == []


def test_messages_that_are_too_large_end_the_connection_alone(open_page):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    with visitor(page.server.port) as one, visitor(page.server.port) as other:
        eventually(lambda: len(page.server.wheel.visitors) == 2)
        one.send(b"x" * (LARGEST + 1))
        with pytest.raises(ConnectionClosed):
            heard_out(one)
        eventually(lambda: page.server.wheel.driver == 1)
        pause = uuid_of(page, page.panel.pause)
        other.say({"type": "GuiUpdateMessage", "uuid": pause, "updates": {"value": True}})
        eventually(lambda: page.runner.snapshot.paused)


@pytest.mark.long
def test_no_message_switches_the_shield_of_a_saved_policy_off(open_page):
    page = open_page(Choices(policy="reach-ppo", shields=(ShieldChoice("yield"),)))
    with visitor(page.server.port) as driver:
        eventually(lambda: page.server.viser.get_clients())
        shield = page.panel.handles["shield"]
        for name in ("unshielded", "none", "jssa", "jssa_published"):
            assert name in shield.options
            driver.say({"type": "GuiUpdateMessage", "uuid": uuid_of(page, shield), "updates": {"value": name}})
            eventually(lambda: "verified stop" in page.runner.snapshot.message)
            assert page.runner.snapshot.choices.shields == (ShieldChoice("yield"),)
            assert page.runner.snapshot.arms[0].promised
            eventually(lambda: shield.value == "yield", what="the switch back at what is")
            page.runner.submit(lambda session: None)  # the message goes with the next command
            eventually(lambda: page.runner.snapshot.message == "")


def test_one_drives_and_the_others_watch_until_the_first_is_gone(open_page):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    pause = uuid_of(page, page.panel.pause)
    with contextlib.ExitStack() as first:
        driver = first.enter_context(visitor(page.server.port))
        eventually(lambda: len(page.server.viser.get_clients()) == 1)
        with visitor(page.server.port) as watcher:
            eventually(lambda: len(page.server.viser.get_clients()) == 2)
            refused = page.server.refused
            watcher.say({"type": "GuiUpdateMessage", "uuid": pause, "updates": {"value": True}})
            eventually(lambda: page.server.refused == refused + 1)
            assert not page.runner.snapshot.paused
            assert page.panel.pause.value is False
            driver.say({"type": "GuiUpdateMessage", "uuid": pause, "updates": {"value": True}})
            eventually(lambda: page.runner.snapshot.paused)
            number = page.runner.snapshot.number
            first.close()  # a tab is closed
            eventually(lambda: page.server.wheel.driver == 1)
            watcher.say({"type": "GuiUpdateMessage", "uuid": pause, "updates": {"value": False}})
            eventually(lambda: page.runner.snapshot.number > number + 5, what="that it goes on")


def test_a_lost_connection_disturbs_nothing(open_page):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    with visitor(page.server.port) as connection:
        eventually(lambda: page.server.wheel.visitors)
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.socket.close()  # without a word
    eventually(lambda: not page.server.wheel.visitors)
    number = page.runner.snapshot.number
    eventually(lambda: page.runner.snapshot.number > number + 5)
    with visitor(page.server.port):
        eventually(lambda: page.server.viser.get_clients())


def test_there_is_an_end_to_how_many_may_watch(server):
    with contextlib.ExitStack() as all_of_them:
        for _ in range(MOST_VISITORS):
            all_of_them.enter_context(visitor(server.port))
        eventually(lambda: len(server.wheel.visitors) == MOST_VISITORS)
        with pytest.raises(ConnectionClosed), visitor(server.port) as one_more:
            heard_out(one_more)
        assert len(server.wheel.visitors) == MOST_VISITORS
