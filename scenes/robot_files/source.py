"""The source of a robot's description and how it is read: its packages, arguments and joints of a mobile base."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hdplan.scenes.robot_spec import PlanarBase


@dataclass(frozen=True)
class Source:
    """A robot's description: what two readers of it must have in common to read the same robot."""

    urdf: Path  # URDF, xacro or MJCF
    package_dirs: tuple[Path, ...] = ()  # where packages are sought first
    xacro_args: tuple[tuple[str, str], ...] = ()  # name, value
    base_joints: PlanarBase | None = None  # that carry the root link
