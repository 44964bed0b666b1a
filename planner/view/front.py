"""Checks before the viewer starts, and before viser, which is optional, is loaded."""

from __future__ import annotations

import importlib.util
import ipaddress
from collections.abc import Sequence
from pathlib import Path

from hdplan.planner.html_page import PAGES
from hdplan.scenes.errors import InputError
from hdplan.scenes.output import check_writable
from hdplan.scenes.robot_spec import RobotSpec


def check_installed() -> None:
    """Raise InputError, saying what to install, if viser is missing."""
    if importlib.util.find_spec("viser") is None:
        raise InputError("the viewer needs viser, which is not installed: pip install viser")


def is_loopback(host: str) -> bool:
    """True if an address is seen by this machine alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_files(page: Path | None, video: Path | None, trajectories: Sequence[Path], served: Sequence[str]) -> None:
    """Check early that the files can be written. Raises InputError for a bad path, a missing library, if there is no
    motion to show, and for options that only a page that is `served` has."""
    if page is not None:
        check_writable(page, PAGES)
    if video is not None:
        from hdplan.planner.page.film import check_film

        check_film(video)
    if not trajectories:
        raise InputError(f"{page or video}: no trajectory was given, so there is no motion to record")
    if served:
        raise InputError(f"{served[0]}: applies to the viewer, which stays closed with {page or video}: leave one out")


def check_proof(proof: Path, trajectories: Sequence[Path], robot: str | RobotSpec | None) -> None:
    """Check early that a proof can be of what is shown. Raises InputError."""
    if len(trajectories) != 1:
        raise InputError(f"--proof: {proof} is about one motion, but {len(trajectories) or 'none'} is given")
    if isinstance(robot, RobotSpec):
        raise InputError(f"--proof: {proof} is about files, so that --xacro-arg does not go with it")


def motion_names(trajectories: Sequence[Path]) -> list[str]:
    """Return a short name for each file that no other one has: its stem, or else its path as it was given, numbered
    where it comes twice."""
    stems = [file.stem for file in trajectories]
    names: list[str] = []
    for file, stem in zip(trajectories, stems, strict=True):
        name = stem if stems.count(stem) == 1 else str(file)
        again = sum(known == name or known.startswith(f"{name} (") for known in names)
        names.append(f"{name} ({again + 1})" if again else name)
    return names
