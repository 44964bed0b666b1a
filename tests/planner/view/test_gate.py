"""Admission to the server, at the wire: a page of another site, of another name or without the secret gets nothing; a
watcher changes nothing; and no file is held that is too large."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
import viser
import websockets.asyncio.server
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view import gate as module
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import MOST_BYTES
from hdplan.scenes.scene import Scene
from tests.waiting import until

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [2.0, 2.0, 2.0],
    "fov": 0.8,
    "image_height": 360,
    "image_width": 400,
    "near": 0.01,
    "far": 100.0,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
PATIENCE = 60.0  # [s]


@pytest.fixture(scope="module")
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    complaints: list[str] = []
    viewer = open_viewer(scene, [("found", trajectory)], port=8380, share=True, complain=complaints.append)
    yield viewer
    viewer.close()
    assert not complaints


def answered(viewer: Viewer, path: str, **headers: str) -> int:
    """The status of the answer to a browser's request."""
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=PATIENCE)
    connection.request("GET", path, headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def test_the_page_is_not_packed_once_more(viewer: Viewer) -> None:
    """The page is packed already: packing took longer than it saved, before every first picture."""
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=PATIENCE)
    connection.request("GET", viewer.gate.paths[False], headers={"Accept-Encoding": "gzip, deflate"})
    answer = connection.getresponse()
    assert (answer.status, answer.headers["Content-Encoding"]) == (200, "identity")
    assert answer.read().startswith(b"<!doctype html>")
    connection.close()


def opened(viewer: Viewer, path: str, **headers: str) -> ClientConnection:
    """A browser's connection, through which it would see and change everything."""
    return connect(
        f"ws://127.0.0.1:{viewer.port}{path.rstrip('/')}",
        subprotocols=[f"viser-v{viser.__version__}"],
        additional_headers=headers,
        max_size=None,
        compression=None,
        open_timeout=PATIENCE,
    )


def send(connection: ClientConnection, *messages: dict[str, Any]) -> None:
    for message in messages:
        connection.send(msgspec.msgpack.encode(message))


def comes_in(viewer: Viewer, page: ClientConnection) -> None:
    """Tell where a page looks from, as it does first, and wait until its camera was set, which it must live to see."""
    send(page, CAMERA)
    until(lambda: bool(viewer.server.get_clients() and viewer.panel.looking._set), "it does not come in")
    assert viewer.worker.settle(PATIENCE)


def here(viewer: Viewer) -> str:
    return f"127.0.0.1:{viewer.port}"


def renaming(viewer: Viewer, value: str = "mine") -> dict[str, Any]:
    """Message of a page where somebody renames the first motion."""
    message = json.dumps({"do": "rename", "motion": viewer.motions.shown[0].number, "answer": value})
    return {"type": "GuiUpdateMessage", "uuid": viewer.gate.page_field, "updates": {"value": message}}


def test_the_address_lets_in_and_no_other(viewer: Viewer) -> None:
    whole, watch = viewer.gate.paths[False], viewer.gate.paths[True]
    assert viewer.address() == f"http://{here(viewer)}{whole}"
    assert len(whole) > 20
    for path in (
        whole,
        whole.rstrip("/"),
        f"{whole}?darkMode",
        watch,
        f"{whole}{module.ALIVE}",
        f"{watch}{module.ALIVE}",
    ):
        assert answered(viewer, path) == 200
    for path in (
        "/",
        "/index.html",
        f"/{'a' * (len(whole) - 2)}/",
        whole[:-3],
        f"{whole}index.html",
        "/watch/",
        "/%2e%2e/",
    ):
        assert answered(viewer, path) == 403
        with pytest.raises(InvalidStatus, match="403"):
            opened(viewer, path)
    with socket.create_connection(("127.0.0.1", viewer.port), timeout=PATIENCE) as plain:
        plain.sendall(b"GET /\xc3\xa9/ HTTP/1.1\r\nHost: %b\r\n\r\n" % here(viewer).encode())
        assert plain.recv(12) == b"HTTP/1.1 403"


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "file://", "http://localhost", "http://127.0.0.1", "http://127.0.0.1:1"]
)
def test_a_page_of_another_site_is_turned_away(viewer: Viewer, origin: str) -> None:
    """Even where it knows the secret."""
    with pytest.raises(InvalidStatus, match="403"):
        opened(viewer, viewer.gate.paths[False], Origin=origin)
    assert answered(viewer, viewer.gate.paths[False], Origin=origin) == 403


@pytest.mark.parametrize(
    "name", ["evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", "", "a@localhost"]
)
def test_a_name_that_another_site_gives_to_this_machine_is_turned_away(viewer: Viewer, name: str) -> None:
    assert answered(viewer, viewer.gate.paths[False], Host=name) == 403


@pytest.mark.parametrize("name", ["localhost", "localhost:9", "LOCALHOST:9", "[::1]:8080", "[::1]", "192.168.0.7:80"])
def test_this_machine_has_several_names(viewer: Viewer, name: str) -> None:
    """As behind a tunnel that has another port."""
    assert answered(viewer, viewer.gate.paths[False], Host=name) == 200
    assert answered(viewer, viewer.gate.paths[False], Host=name, Origin=f"http://{name}") == 200


def test_the_page_itself_may_change_everything(viewer: Viewer) -> None:
    with opened(viewer, viewer.gate.paths[False], Origin=f"http://{here(viewer)}") as page:
        comes_in(viewer, page)
        send(page, renaming(viewer))
        until(lambda: viewer.motions.shown[0].motion.name == "mine", "it keeps its name")
    until(lambda: not viewer.server.get_clients(), "it does not leave")


def test_a_watching_browser_sees_everything_and_changes_nothing(viewer: Viewer) -> None:
    """Of all messages that a page sends, only its camera and its colour scheme pass."""
    gui = viewer.server.gui._gui_input_handle_from_uuid
    slider = viewer.panel.player.slider._impl.uuid
    before = viewer.edited, [shown.motion for shown in viewer.motions.shown]
    with opened(viewer, viewer.gate.paths[True]) as page:
        assert len(page.recv(timeout=PATIENCE)) > 1000
        comes_in(viewer, page)
        message = json.dumps({"do": "theme", "dark": True})
        field = {"type": "GuiUpdateMessage", "uuid": viewer.gate.page_field}
        send(
            page,
            renaming(viewer, "stolen"),
            {"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": 0.5}},
            {"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": message}},
            {**field, "updates": {"value": message, "visible": True}},
            {**field, "updates": {"value": "[" * 10000}},
            {"type": "SceneNodeClickMessage", "name": "/obstacles/1/mesh", "instance_index": None},
            {
                "type": "TransformControlsUpdateMessage",
                "name": "/handle/1",
                "wxyz": [1, 0, 0, 0],
                "position": [0, 0, 0],
            },
            *({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": True}} for uuid in gui),
            {"type": "CommandTriggerMessage", "uuid": next(iter(viewer.server.gui._command_handle_from_uuid))},
            beginning(1000),
            {**field, "updates": {"value": message}},
        )
        page.send(b"\xc1 no message")
        page.send("no bytes")
        until(lambda: viewer.panel.page._field.value == message, "the page may not be dark")
    assert viewer.worker.settle(PATIENCE)
    assert (viewer.edited, [shown.motion for shown in viewer.motions.shown]) == before
    assert viewer.panel.player.time == 0.0
    assert viewer.panel.handles.selected is None
    until(lambda: not viewer.server.get_clients(), "it does not leave")


def test_nobody_watches_unless_it_is_shared(scene: Scene) -> None:
    viewer = open_viewer(scene, port=8380)
    try:
        assert list(viewer.gate.paths) == [False]
        assert answered(viewer, "/watch/") == 403
        assert answered(viewer, "/watch/a/") == 403
    finally:
        viewer.close()


def beginning(size: int, parts: int = 1, transfer: str = "t") -> dict[str, Any]:
    return {
        "type": "FileTransferStartUpload",
        "source_component_uuid": "",
        "transfer_uuid": transfer,
        "filename": "a.stl",
        "mime_type": "",
        "size_bytes": size,
        "part_count": parts,
    }


def part(content: bytes, index: int = 0, transfer: str = "t") -> dict[str, Any]:
    return {
        "type": "FileTransferPart",
        "source_component_uuid": "",
        "transfer_uuid": transfer,
        "part_index": index,
        "content": content,
    }


def let_in(gate: module.Gate) -> Callable[[dict[str, Any]], bool]:
    """True if a connection passes a message."""
    connection = module.Guarded.__new__(module.Guarded)
    connection.gate, connection.watches, connection._files = gate, False, {}
    return lambda message: connection._may_come_in(msgspec.msgpack.encode(message))


def test_no_camera_comes_in_from_which_there_is_no_picture() -> None:
    """One of a watching browser withdrew the verdicts of all."""
    may, nan = let_in(module.Gate("127.0.0.1")), float("nan")
    assert may(CAMERA)
    for wrong in (
        {"look_at": [nan] * 3},
        {"look_at": None},
        {"position": [1e308] * 3},
        {"position": [1.0]},
        {"up_direction": [0, 0, 0]},
        {"wxyz": [0, 0, 0, 0]},
        {"wxyz": [1.0]},
        {"fov": 0.0},
        {"fov": nan},
        {"near": float("inf")},
        {"image_height": 0},
        {"image_width": "x"},
    ):
        assert not may(CAMERA | wrong), wrong


def test_a_file_is_refused_before_it_is_held() -> None:
    gate = module.Gate("127.0.0.1")
    may = let_in(gate)
    assert not may(part(b"1234"))
    assert not may(beginning(MOST_BYTES + 1, 300))
    assert not may(beginning(-1))
    assert not may(beginning(1000, 10**9))  # of parts without content
    assert may(beginning(10, 2 - 1))
    assert not may(beginning(10, 1))  # twice
    assert not may(part(b"longer than announced, and more"))
    assert may(part(b"0123456789"))
    assert not may(part(b"", 1))
    assert gate.uploading == 0


def test_all_files_under_way_have_room_together_or_none() -> None:
    gate = module.Gate("127.0.0.1")
    one, other = let_in(gate), let_in(gate)
    assert one(beginning(MOST_BYTES - 1000, 200, "large"))
    assert not other(beginning(2000))
    assert other(beginning(1000))
    assert other(part(b"1" * 1000))
    assert gate.uploading == MOST_BYTES - 1000
    assert one(part(b"1" * 1000, 3, "large"))
    assert not one(part(b"1" * 1000, 3, "large"))  # again
    assert gate.uploading == MOST_BYTES - 1000


def test_files_of_a_page_that_leaves_are_forgotten(viewer: Viewer) -> None:
    with opened(viewer, viewer.gate.paths[False]) as page:
        comes_in(viewer, page)
        send(page, beginning(1_000_000, 2))
        until(lambda: viewer.gate.uploading == 1_000_000, "it is not let in")
    until(lambda: viewer.gate.uploading == 0, "it is held for ever")


def test_no_page_opens_a_way_in_from_the_internet() -> None:
    assert not any(let_in(module.Gate("127.0.0.1"))({"type": kind}) for kind in module.NEVER)


def test_a_message_that_is_too_long_is_not_received(viewer: Viewer) -> None:
    with opened(viewer, viewer.gate.paths[False]) as page:
        page.send(b"0" * (module.MOST_MESSAGE + 1))
        with pytest.raises(websockets.exceptions.ConnectionClosed, match="1009"):
            list(page)


def test_a_viser_that_makes_its_server_in_another_way_is_refused(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """And its server ends."""
    plain, made = viser.ViserServer, []

    def otherwise(*args: Any, **options: Any) -> viser.ViserServer:
        with monkeypatch.context() as within:
            within.setattr(websockets.asyncio.server, "serve", unguarded)
            made.append(plain(*args, **options))
        return made[0]

    unguarded = websockets.asyncio.server.serve
    monkeypatch.setattr(viser, "ViserServer", otherwise)
    with pytest.raises(InputError, match="cannot be guarded"):
        open_viewer(scene, port=8380)
    with pytest.raises(OSError, match="refused"):
        http.client.HTTPConnection("127.0.0.1", made[0].get_port(), timeout=5).connect()
    assert websockets.asyncio.server.serve is unguarded
