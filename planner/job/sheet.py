"""The motion of a job on one sheet: its stages, the arm's joints and rates, clearances stage by stage, and the scene in
which the arm first moves."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.job.certify import JobCertificate
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.plot import Subject, check_picture, write_picture
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.scene import derived

DISTANCE_SAMPLES = 24  # at a stage's distances
SHORTEST_NAME = 0.04  # share of the motion that a stage takes whose name is written


def plot_job(certificate: JobCertificate, trajectory: Trajectory, path: Path) -> None:
    """Draw the motion of a job and write the sheet to `path`, whole or not at all. Raises InputError as `plot`, and
    HdplanError for a job in which the arm never moves."""
    check_picture(path)
    from hdplan.planner.pictures.sheet import motion_panels, sheet_of

    arm = next((stage for stage in certificate.stages if stage.arm is None), None)
    if arm is None:
        raise HdplanError("there is nothing to draw: no stage is planned in which the arm moves")
    certifier = Certifier(Setup.of(derived(arm.scene, name=certificate.job)))
    robot = certifier.robot
    moved = trajectory.of_joints(robot.joint_names, {})
    whole = replace(arm.certificate, text=certificate.text, uses=(), failures=(), departures=(), overloaded=())
    if (failed := certificate.failed) is not None:
        whole = replace(whole, status=failed.certificate.status)
    subject = Subject(certifier, moved, whole, (), trajectory.extent)
    first, last = (functools.partial(draw, certificate=certificate) for draw in (_draw_stages, _draw_clearances))
    write_picture(sheet_of(subject, [(0.45, first), *motion_panels(subject), (1.1, last)]), path)


def _draw_stages(axis: Any, subject: Subject, certificate: JobCertificate) -> None:
    """Draw the stages as a bar over time, with the names of those that have room for one."""
    from hdplan.planner.pictures.panels import lay_along
    from hdplan.planner.pictures.style import CONTACT, GREY, INK, plain

    ends = certificate.stages[-1].ends
    for number, stage in enumerate(certificate.stages):
        color = CONTACT if not stage.certificate.certified else INK if number % 2 else GREY
        axis.axvspan(stage.begins, stage.ends, color=color, alpha=0.3, linewidth=0)
        if stage.ends - stage.begins >= SHORTEST_NAME * ends:
            middle = 0.5 * (stage.begins + stage.ends)
            axis.text(middle, 0.5, plain(stage.name, 16), rotation=60, ha="center", va="center", fontsize=6.5)
    axis.set(ylim=(0.0, 1.0), yticks=[], title="stages")
    lay_along(axis, subject.trajectory)


def _draw_clearances(axis: Any, subject: Subject, certificate: JobCertificate) -> None:
    """Draw the exact distances in each stage, of what is compared in it, and what is proven of them."""
    from hdplan.planner.pictures.clearances import exact
    from hdplan.planner.pictures.panels import above, lay_along
    from hdplan.planner.pictures.style import BETWEEN_LINKS, ROBOT_TO_OBSTACLES

    drawn = set[str]()

    def draw(when: Any, values: Any, label: str, **style: Any) -> None:
        axis.plot(when, values, label=None if label in drawn else label, **style)
        drawn.add(label)

    for stage in certificate.stages:
        certifier = Certifier(Setup.of(stage.scene))
        curve = curve_of(certifier.robot, stage.trajectory)
        shares = np.linspace(0.0, 1.0, DISTANCE_SAMPLES)
        when = curve.time_of(shares)
        places, between = exact(certifier, curve.at_parameter(shares), when)
        if places:
            draw(when, [1e3 * x.distance for x in places], "to obstacles, exact", color=ROBOT_TO_OBSTACLES)
        if len(between):
            draw(when, 1e3 * between, "between links, exact", color=BETWEEN_LINKS, linestyle="--")
        _draw_bound(draw, when, stage.certificate, ROBOT_TO_OBSTACLES)
    axis.set(ylabel="distance [mm]", title="clearance, stage by stage")
    bottom, highest = axis.get_ylim()
    axis.set_ylim(min(0.0, bottom), above(axis, min(0.0, bottom), highest))
    lay_along(axis, subject.trajectory)
    if drawn:
        axis.legend(ncols=2, loc="upper left", borderpad=0.1, columnspacing=1.2, handlelength=2.2)


def _draw_bound(draw: Any, when: Any, certificate: Certificate, color: str) -> None:
    if certificate.certified and certificate.clearance is not None:
        draw(when[[0, -1]], [1e3 * certificate.clearance] * 2, "proven", color=color, linestyle=":")
