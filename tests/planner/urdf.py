"""Robot descriptions in a few words: links with a shape, and the joints between them."""

from __future__ import annotations

from pathlib import Path


def link_text(
    name: str,
    *,
    box: str = "",
    sphere: float | None = None,
    cylinder: tuple[float, float] | None = None,
    mesh: Path | str = "",
    at: str = "0 0 0",
    rpy: str = "0 0 0",
    inertial: str = "",
) -> str:
    """A link with one shape, or without geometry: a box by its size, a cylinder by radius and length, a mesh by its
    file."""
    shape = f'<box size="{box}"/>' if box else f'<mesh filename="{mesh}"/>' if mesh else ""
    shape = shape if sphere is None else f'<sphere radius="{sphere}"/>'
    shape = shape if cylinder is None else f'<cylinder radius="{cylinder[0]}" length="{cylinder[1]}"/>'
    place = f'<origin xyz="{at}" rpy="{rpy}"/>'
    body = f"<collision>{place}<geometry>{shape}</geometry></collision>" if shape else ""
    return f'<link name="{name}">{inertial}{body}</link>' if inertial or body else f'<link name="{name}"/>'


def joint_text(
    name: str,
    parent: str,
    child: str,
    axis: str = "0 0 1",
    *,
    kind: str = "revolute",
    limits: tuple[float, float] = (-1.0, 1.0),
    at: str = "0 0 0",
    rpy: str = "0 0 0",
    velocity: float = 1.0,
    effort: float = 1.0,
) -> str:
    """A joint; one that is fixed or turns without end has no limits."""
    limit = f'<limit lower="{limits[0]}" upper="{limits[1]}" velocity="{velocity}" effort="{effort}"/>'
    limit = "" if kind in ("fixed", "continuous") else limit
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def robot_text(*parts: str, name: str = "robot") -> str:
    """The description of a robot of these links and joints."""
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def write_robot(file: Path, *parts: str) -> Path:
    """Write the description of a robot that is named as its file."""
    file.write_text(robot_text(*parts, name=file.stem), encoding="utf-8")
    return file
