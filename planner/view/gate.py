"""The gate of the page: an address holds a secret, as Jupyter's does, and pages of other sites are rejected.

viser serves whoever asks. Its server is made by `websockets.asyncio.server.serve`, which is given a check of every
request and a connection that drops forbidden messages; a viser that makes its server in another way is not used.
"""

from __future__ import annotations

import asyncio
import contextlib
import http
import ipaddress
import json
import logging
import math
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import msgspec
import websockets.asyncio.server as serving
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.protocol import State

from hdplan.planner.view.quiet import quiet
from hdplan.scenes.files import MOST_BYTES

WATCH = "watch"  # begins the path of an address that shows everything and changes nothing
ALIVE = "alive"  # ends the path of the address at which a page asks whether the server is there
MOST_MESSAGE = 2_000_000  # [bytes] of one message; files come in parts of half a megabyte
SMALLEST_PART = 65_536  # [bytes] on average, of a file that comes in parts
FARTHEST = 1e6  # [m] of a camera
NO_SECRET = "This address lacks its secret part: open the one that hdplan view has written.\n"
ELSEWHERE = "This request was made for another machine, or by a page of another site: it is refused.\n"
UNGUARDED = "this version of viser makes its server in a way that cannot be guarded: take viser 1.1.1"
CAMERA, FIELD, BEGIN, PART = "ViewerCameraMessage", "GuiUpdateMessage", "FileTransferStartUpload", "FileTransferPart"
NEVER = ("ShareUrlRequest", "ShareUrlDisconnect")  # would open a way in from the internet, past this gate

Check = Callable[[ServerConnection, Request], Response | None]


class Gate:
    """The secrets of one server, and what may come in by which."""

    def __init__(self, host: str, share: bool = False) -> None:
        """Make the secrets of a server that listens at `host`; with `share`, one that lets others watch, too."""
        self._names = {"localhost", host.lower(), *(f"{socket.gethostname().lower()}{end}" for end in ("", ".local"))}
        everywhere = host in ("0.0.0.0", "::", "")  # which is no address that a browser could open
        self._shown = socket.gethostname() if everywhere else f"[{host}]" if ":" in host else host
        self.paths = {False: f"/{secrets.token_urlsafe(16)}/"}  # by whether who comes by it only watches
        if share:
            self.paths[True] = f"/{WATCH}/{secrets.token_urlsafe(16)}/"
        self.page_field = ""  # the field in which pages tell their colour scheme, as viser names it
        self.uploading = 0  # [bytes] of the files under way, of all browsers
        self._connections: set[Guarded] = set()

    def address(self, port: int, watch: bool = False) -> str:
        """Return the address by which everything can be changed, or, if that is shared, only watched."""
        return f"http://{self._shown}:{port}{self.paths[watch]}"

    @contextlib.contextmanager
    def guarding(self) -> Iterator[list[Any]]:
        """Guard the servers that viser makes within, and list them."""
        made: list[Any] = []

        def serve(handler: Any, *args: Any, **options: Any) -> Any:
            answer = options.get("process_request")
            if answer is not None and handler.__module__.startswith("viser."):  # and not of another thread
                made.append(handler)
                opened = partial(Guarded, connections=self._connections)
                options |= {"process_request": self._admitting(answer), "create_connection": opened}
                options |= {"max_size": MOST_MESSAGE, "logger": _SILENT}
            return plain(handler, *args, **options)

        with _making:
            plain = serving.serve
            serving.serve = serve  # type: ignore[misc, assignment]
            try:
                yield made
            finally:
                serving.serve = plain  # type: ignore[misc]

    def close(self) -> None:
        """End the connections that wait for a request, as browsers open some ahead of need: for their sake a server
        that stops would wait for seconds."""
        for connection in list(self._connections):
            if connection.protocol.state is State.CONNECTING:
                connection.loop.call_soon_threadsafe(connection.transport.abort)

    def _admitting(self, answer: Check) -> Check:
        """Return viser's own `answer` to a request, for those that may enter."""

        def admit(connection: ServerConnection, request: Request) -> Response | None:
            if not (isinstance(connection, Guarded) and self._is_of_this_site(request)):
                return connection.respond(http.HTTPStatus.FORBIDDEN, ELSEWHERE)
            path = f"{request.path.partition('?')[0].rstrip('/')}/".encode(errors="surrogateescape")  # as it came
            for watches, own in self.paths.items():
                if secrets.compare_digest(path, f"{own}{ALIVE}/".encode()):
                    return connection.respond(http.HTTPStatus.OK, "")
                if secrets.compare_digest(path, own.encode()):
                    connection.gate, connection.watches = self, watches
                    local = replace(request, path="/", headers=_unpacked(request.headers))  # its client is one file
                    response = answer(connection, local)
                    if response is not None:
                        response.headers["Referrer-Policy"] = "no-referrer"  # as the address is a secret
                    return response
            return connection.respond(http.HTTPStatus.FORBIDDEN, NO_SECRET)

        return admit

    def _is_of_this_site(self, request: Request) -> bool:
        """True if a request is made for this machine, and by a page of this server if by any page."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_this_machine(hosts[0]):
            return False
        return not origins or origins in ([f"http://{hosts[0]}"], [f"https://{hosts[0]}"])

    def _is_this_machine(self, host: str) -> bool:
        """True if no other site can have given this name, with or without a port, to this machine: numbers name it, and
        what it calls itself."""
        name = host.lower()
        if ":" in name.rpartition("]")[2]:
            name = name.rpartition(":")[0]
        try:
            ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return name in self._names
        return True


class Served:
    """Base of viewers that a server shows behind a gate."""

    server: Any  # viser's
    gate: Gate

    @property
    def port(self) -> int:
        """The port on which it is served."""
        return int(self.server.get_port())

    def close(self) -> None:
        """End the server."""
        self.gate.close()
        with quiet():
            self.server.stop()

    def address(self, watch: bool = False) -> str:
        """Return the viewer's address: the one with write access, or the shared one for watching. Raises KeyError if it
        is not shared."""
        return self.gate.address(self.port, watch)


@dataclass
class _File:
    """A file that is on its way."""

    size: int  # [bytes]
    parts: int
    came: set[int] = field(default_factory=set)
    left: int = 0  # [bytes]


class Guarded(ServerConnection):
    """A browser's connection, of which only what may come in is received."""

    gate: Gate | None = None  # None: nothing may
    watches = True

    def __init__(self, *args: Any, connections: set[Guarded], **options: Any) -> None:
        """Begin without any files under way; while it is open, it is one of `connections`."""
        super().__init__(*args, **options)
        self._connections = connections
        self._files: dict[str, _File] = {}  # by transfer

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count as one of the open connections."""
        self._connections.add(self)
        super().connection_made(transport)

    async def recv(self, decode: bool | None = None) -> Any:
        """Receive the next allowed message."""
        while True:
            data = await super().recv(decode)
            if self._may_come_in(data):
                return data

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget its files, as viser does."""
        self._connections.discard(self)
        for transfer in list(self._files):
            self._forget(transfer)
        super().connection_lost(exc)

    def _may_come_in(self, data: Any) -> bool:
        try:
            kind = _KIND.decode(data).type
            if self.gate is None or kind in NEVER:
                return False
            if kind == CAMERA:
                return _is_a_view(_CAMERA.decode(data))
            if self.watches:
                return kind == FIELD and _tells_the_scheme(_FIELD.decode(data), self.gate)
            if kind == BEGIN:
                return self._begin(_BEGIN.decode(data), self.gate)
            return kind != PART or self._goes_on(_PART.decode(data))
        except (msgspec.MsgspecError, TypeError):
            return False

    def _begin(self, begin: _Begin, gate: Gate) -> bool:
        """True if there is room for a file: those that are under way are held in memory."""
        size, parts, transfer = begin.size_bytes, begin.part_count, begin.transfer_uuid
        room = 0 <= size <= MOST_BYTES - gate.uploading and 0 <= parts <= 1 + size // SMALLEST_PART
        if transfer in self._files or not room:
            return False
        if parts:
            self._files[transfer] = _File(size, parts, left=size)
            gate.uploading += size
        return True

    def _goes_on(self, part: _Part) -> bool:
        """True if a part is of a file that was let in, a new one, and no longer than what is left of it."""
        file = self._files.get(part.transfer_uuid)
        if file is None or part.part_index in file.came or len(part.content) > file.left:
            return False
        file.came.add(part.part_index)
        file.left -= len(part.content)
        if len(file.came) == file.parts:
            self._forget(part.transfer_uuid)
        return True

    def _forget(self, transfer: str) -> None:
        assert self.gate is not None
        self.gate.uploading -= self._files.pop(transfer).size


def _unpacked(headers: Headers) -> Headers:
    """Return headers of a request for a file as it is: viser's client is packed, and to pack it again takes longer than
    it saves."""
    return Headers((name, value) for name, value in headers.raw_items() if name.lower() != "accept-encoding")


def _tells_the_scheme(sent: _Field, gate: Gate) -> bool:
    """True if a page tells whether it is dark, and nothing else."""
    if not gate.page_field or sent.uuid != gate.page_field or list(sent.updates) != ["value"]:
        return False
    try:
        message = json.loads(sent.updates["value"])
    except (TypeError, ValueError, RecursionError):
        return False
    return isinstance(message, dict) and message.get("do") == "theme"


def _is_a_view(camera: _Camera) -> bool:
    """True if there is a picture from there: for any other the pictures of all would fail."""
    turn, up = camera.wxyz, camera.up_direction
    places = (*camera.position, *camera.look_at, *turn, *up, camera.near, camera.far)
    sized = min(camera.image_width, camera.image_height) >= 1 and max(camera.image_width, camera.image_height) < 1e5
    return (
        all(abs(value) <= FARTHEST for value in places)
        and min(math.hypot(*turn), math.hypot(*up)) > 1e-6
        and 0.0 < camera.fov < math.pi
        and sized
    )


class _Kind(msgspec.Struct):
    """Kind of a message."""

    type: str


class _Camera(msgspec.Struct):
    """The place of a browser's camera."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    wxyz: tuple[float, float, float, float]
    up_direction: tuple[float, float, float]
    fov: float  # [rad]
    near: float
    far: float
    image_width: float  # [px]
    image_height: float


class _Field(msgspec.Struct):
    """A value for an input."""

    uuid: str
    updates: dict[str, Any]


class _Begin(msgspec.Struct):
    """The beginning of a file."""

    transfer_uuid: str
    size_bytes: int
    part_count: int


class _Part(msgspec.Struct):
    """A part of a file."""

    transfer_uuid: str
    part_index: int
    content: memoryview


_KIND, _FIELD = msgspec.msgpack.Decoder(_Kind), msgspec.msgpack.Decoder(_Field)
_CAMERA = msgspec.msgpack.Decoder(_Camera)
_BEGIN, _PART = msgspec.msgpack.Decoder(_Begin), msgspec.msgpack.Decoder(_Part)
_SILENT = logging.Logger("hdplan.view")  # of requests that fail, which are others' affairs
_SILENT.addHandler(logging.NullHandler())
_making = threading.Lock()  # of one server at a time
