"""Serving a scene to browsers, by default on this machine only, until Ctrl-C.

On the requested port, or the next free one.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

import viser

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.gate import UNGUARDED, Gate, Served
from hdplan.planner.view.page_script import WIDTH
from hdplan.planner.view.quiet import quiet
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.view.job_viewer import JobViewer

HOST, PORT = "127.0.0.1", 8080
TRIED_PORTS = 100  # ports after the wanted one
Shown = TypeVar("Shown")


def open_viewer(
    scene: Scene,
    trajectories: Sequence[tuple[str, Trajectory]] = (),
    *,
    robot: Robot | None = None,
    host: str = HOST,
    port: int = PORT,
    share: bool = False,
    complain: Callable[[str], object] = lambda text: None,
    found: Callable[[Served], object] = lambda viewer: None,
) -> Viewer:
    """Begin to serve a scene with trajectories by name; `viewer.close()` ends it.

    `found` is called with what knows the address as soon as all is checked, while the rest is being drawn: a browser
    loads its part meanwhile.

    `viewer.address()` is where browsers find it; with `share`, `viewer.address(watch=True)` is where others see
    everything and change nothing. Raises InputError for a host that is not this machine, if no
    port is free, or for trajectories that do not fit the scene's robot.
    """
    setup = Setup.of(scene, robot)

    def viewer_of(server: viser.ViserServer, gate: Gate) -> Viewer:
        return Viewer(server, gate, setup, trajectories, complain, found)

    return _served(scene, host, port, share, viewer_of)


def open_job_viewer(
    scene: Scene,
    trajectory: Trajectory | None = None,
    *,
    host: str = HOST,
    port: int = PORT,
    share: bool = False,
    complain: Callable[[str], object] = lambda text: None,
) -> JobViewer:
    """Begin to serve a scene with a job, and a motion of it, as `open_viewer` does a scene with motions."""
    from hdplan.planner.view.job_viewer import JobViewer  # with the planner of jobs

    return _served(scene, host, port, share, lambda server, gate: JobViewer(server, gate, scene, trajectory, complain))


def _served(
    scene: Scene, host: str, port: int, share: bool, viewer_of: Callable[[viser.ViserServer, Gate], Shown]
) -> Shown:
    """Return a viewer on a server of its own, guarded by a gate."""
    chosen = free_port(host, port)
    gate = Gate(host, share)
    with quiet(), gate.guarding() as guarded:
        server = viser.ViserServer(host=host, port=chosen, verbose=False, label=scene.name)
    try:
        if not guarded:
            raise InputError(UNGUARDED)
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()  # next to the scene, not over it
        server.gui.main_panel.set_width(WIDTH)
        return viewer_of(server, gate)
    except BaseException:
        gate.close()
        with quiet():
            server.stop()
        raise


def free_port(host: str, wanted: int) -> int:
    """Return the first free port, beginning at `wanted`. Raises InputError if there is none, or `host` cannot be
    served."""
    for port in range(wanted, min(wanted + TRIED_PORTS, 65536)):
        try:
            kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            with socket.socket(kind, socket.SOCK_STREAM) as trial:
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: no wait after an end
                trial.bind(address)
            return port
        except socket.gaierror:
            raise InputError(f"--host: '{host}' is not an address of this machine") from None
        except PermissionError:
            raise InputError(f"--port: {port} is not allowed to you; take one from 1024 to 65535") from None
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise InputError(f"--host: '{host}' is not an address of this machine") from None
    raise InputError(f"--port: none of the {TRIED_PORTS} ports from {wanted} is free")
