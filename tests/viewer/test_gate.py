"""Who may come in, what a page may say, and who drives."""

import numpy as np
import pytest

from jssa_gym.exceptions import ParameterError
from jssa_gym.viewer.gate import RELIEVED, Door, Speech, Wheel, number, one_of, switch

TOKEN = "a-token-of-twenty-ch"


# ---- the door ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "origin", "websocket"),
    [
        ("127.0.0.1:8765", None, False),
        ("localhost:8765", None, False),
        ("LOCALHOST:8765", None, False),
        ("localhost:9000", "http://localhost:9000", True),  # behind a forwarded port
        ("127.0.0.1:8765", "http://127.0.0.1:8765", True),
        ("127.0.0.1:8765", "http://127.0.0.1:8765", False),
    ],
)
def test_pages_of_this_machine_come_in(host, origin, websocket):
    headers = {"Host": host} | ({} if origin is None else {"Origin": origin})
    assert Door().refusal(headers, websocket) == ""


@pytest.mark.parametrize(
    ("host", "origin", "websocket", "said"),
    [
        ("evil.example:8765", None, False, "Host"),
        ("evil.example", None, False, "Host"),
        ("localhost.evil.example:8765", None, False, "Host"),
        ("127.0.0.1.evil.example", None, False, "Host"),
        ("localhost@evil.example", None, False, "Host"),
        ("evil.example#localhost", None, False, "Host"),
        ("localhost/../x", None, False, "Host"),
        ("localhost:port", None, False, "Host"),
        ("", None, False, "Host"),
        (None, None, False, "Host"),
        ("192.168.1.7:8765", None, False, "Host"),
        ("127.0.0.1:8765", None, True, "Origin"),
        ("127.0.0.1:8765", "http://evil.example", True, "Origin"),
        ("127.0.0.1:8765", "http://127.0.0.1:8766", True, "Origin"),  # another server of this machine
        ("127.0.0.1:8765", "http://localhost:8765", True, "Origin"),
        ("127.0.0.1:8765", "null", True, "Origin"),
        ("127.0.0.1:8765", "file://127.0.0.1:8765", True, "Origin"),
        ("127.0.0.1:8765", "http://evil.example", False, "Origin"),
        ("evil.example:8765", "http://evil.example:8765", True, "Host"),  # a name that was bent to 127.0.0.1
    ],
)
def test_others_do_not(host, origin, websocket, said):
    headers = {name: value for name, value in (("Host", host), ("Origin", origin)) if value is not None}
    assert said in Door().refusal(headers, websocket)


def test_another_host_needs_a_token_and_is_one():
    with pytest.raises(ParameterError, match="--token"):
        Door("192.168.1.7")
    for everywhere in ("0.0.0.0", "::", ""):
        with pytest.raises(ParameterError, match="one address"):
            Door(everywhere, TOKEN)
    door = Door("192.168.1.7", TOKEN)
    assert door.refusal({"Host": "192.168.1.7:8765"}, False) == ""
    assert door.refusal({"Host": "192.168.1.8:8765"}, False) != ""


@pytest.mark.parametrize(
    "token", ["", "short", "with a blank in it", "with;semicolon-in-it", "ümlaute-ümlaute-ümlaute"]
)
def test_tokens_are_long_and_plain(token):
    with pytest.raises(ParameterError, match="16 or more"):
        Door(token=token)


def test_a_token_is_told_by_the_path_once_and_by_a_cookie_from_then_on():
    door = Door(token=TOKEN)
    assert door.told(f"/?token={TOKEN}")
    for path in ("/", "/?token=", f"/?token={TOKEN}x", f"/?token={TOKEN}&token=x", f"/{TOKEN}", "/?token=%C3%BC"):
        assert not door.told(path)
    assert door.known(f"other=1; jssa={TOKEN}", "jssa")
    for cookies in ("", "jssa=", f"jssa={TOKEN}x", f"other={TOKEN}", "jssa", ";;;=", f"jssa=x; jssa={TOKEN}x"):
        assert not door.known(cookies, "jssa")
    assert Door().known("", "jssa")


# ---- speech --------------------------------------------------------------------------------------------

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0, 0, 0],
    "position": [0.0, 1, 2],
    "fov": 0.7,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 400,
    "image_width": 600,
    "look_at": [0.0, 0, 0],
    "up_direction": [0.0, 0, 1],
}
DRAG = {
    "type": "SceneNodeDragMessage",
    "phase": "start",
    "name": "/person",
    "instance_index": 3,
    "start_position": [0.0, 0, 0],
    "start_screen_pos": [0.1, 0.2],
    "end_position": [1.0, 0, 0],
    "end_screen_pos": [0.3, 0.2],
    "button": "left",
    "modifier": None,
    "owner": "",
}


def said(uuid, value):
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}


@pytest.fixture
def speech():
    options = ("one", "two")
    return Speech(
        {"switch": switch, "slider": number(0.0, 2.0), "list": one_of(lambda: options)},
        {"/person": 6},
    )


def test_what_widgets_can_say_is_understood(speech):
    for message in (
        *(CAMERA, DRAG, {**DRAG, "phase": "update"}, {**DRAG, "phase": "end"}),
        *(said("switch", True), said("switch", False), said("slider", 0), said("slider", 1.5), said("list", "two")),
    ):
        assert speech.understands(message)
    assert speech.drives(DRAG)
    assert not speech.drives(CAMERA)


@pytest.mark.parametrize(
    "message",
    [
        *(None, 7, "text", [], [CAMERA], {}, {1: 2}, {"type": None}, {"type": []}),
        *({"type": "ShareUrlRequest"}, {"type": "ResetGuiMessage"}, {"type": "RunJavascriptMessage", "source": "x"}),
        *({"type": "FileTransferStartUpload"}, {"type": "GetRenderResponseMessage"}),
        *(said("unknown", True), said(None, True), said([], True)),
        *(said("switch", value) for value in (1, "True", None, [], {}, 0.0)),
        *(said("slider", value) for value in (-0.1, 2.1, np.nan, np.inf, "1", None, True, [1.0])),
        *(said("list", value) for value in ("three", "", None, 1, ["one"], "one ")),
        {**said("switch", True), "more": 1},
        {"type": "GuiUpdateMessage", "uuid": "switch", "updates": {"update_cb": []}},
        {"type": "GuiUpdateMessage", "uuid": "switch", "updates": {"value": True, "removed": True}},
        {"type": "GuiUpdateMessage", "uuid": "switch", "updates": {}},
        {"type": "GuiUpdateMessage", "uuid": "switch"},
        *({**CAMERA, key: value} for key, value in (("fov", np.nan), ("wxyz", [1.0]), ("near", -1.0), ("more", 1))),
        {key: value for key, value in CAMERA.items() if key != "far"},
        *({**CAMERA, "position": value} for value in ([0.0, 0, np.inf], [0.0, 0, "0"], [1e9, 0, 0], None, "abc")),
        *({**DRAG, "name": value} for value in ("/table", "", None, ["/person"])),
        *({**DRAG, "instance_index": value} for value in (6, -1, None, True, 1.0, "1")),
        *({**DRAG, "end_position": value} for value in ([np.nan, 0, 0], [1e9, 0, 0], [0.0, 0], None)),
        *({**DRAG, key: value} for key, value in (("phase", "middle"), ("button", "right"), ("modifier", "shift"))),
        {**DRAG, "owner": "client_3"},
        {key: value for key, value in DRAG.items() if key != "owner"},
    ],
    ids=str,
)
def test_nothing_else_is(speech, message):
    assert not speech.understands(message)


# ---- the wheel -----------------------------------------------------------------------------------------


def test_who_came_first_drives_and_then_the_next():
    wheel = Wheel(lambda: 0.0)
    for visitor in (3, 5, 8):
        wheel.enter(visitor)
    assert wheel.may_drive(3)
    assert not wheel.may_drive(5)
    assert not wheel.may_drive(99)
    wheel.leave(5)
    wheel.leave(3)
    wheel.leave(3)
    assert wheel.driver == 8
    assert wheel.may_drive(8)
    wheel.leave(8)
    assert wheel.driver is None
    wheel.enter(9)
    assert wheel.may_drive(9)


def test_who_does_nothing_is_relieved_by_who_does_something():
    now = [0.0]
    wheel = Wheel(lambda: now[0])
    wheel.enter(1)
    wheel.enter(2)
    now[0] = RELIEVED - 1.0
    assert not wheel.may_drive(2)
    assert wheel.may_drive(1)
    now[0] += RELIEVED - 1.0
    assert not wheel.may_drive(2)
    now[0] += 2.0
    assert not wheel.may_drive(99)  # nobody who is not there
    assert wheel.may_drive(2)
    assert not wheel.may_drive(1)
