"""The words of a job's page as HTML: the verdict on the whole, and a line for each stage."""

from __future__ import annotations

import html

from hdplan.planner.certificate.verdict import proven_length
from hdplan.planner.job.certify import StageCertificate
from hdplan.planner.view.drawing.colors import clearance_legend, color_legend
from hdplan.planner.view.drawing.motion import shortened
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.motion_nodes import verdict_color
from hdplan.planner.view.page_script import telling
from hdplan.planner.view.words import SHORT, badge_of

NO_MOTION = "no motion of this job in this scene yet: press Plan"
LONGEST = 24  # characters of a stage's name in the scene


def job_words(edited: EditedJob) -> str:
    """Say what is known of a job."""
    if edited.shown is None:
        return NO_MOTION
    if edited.failure:
        return f"not certified: {edited.failure}"
    return edited.shown.certificate.text


def job_badge(edited: EditedJob, planning: bool = False) -> str:
    """Return the verdict in a few words, that stand in the scene."""
    if edited.shown is None:
        return badge_of("", "… planning" if planning else "… no motion in this scene yet")
    certificate, count = edited.shown.certificate, len(edited.shown.certificate.stages)
    if edited.certified:
        clear = "" if certificate.clearance is None else f" {proven_length(certificate.clearance)}"
        return badge_of("good", f"✓ certified{clear}, all {count} stages")
    if (stage := certificate.failed) is not None:
        return badge_of("bad", f"✕ {shortened(stage.name, LONGEST)}: {SHORT[stage.certificate.status]}")
    return badge_of("bad", f"✕ {count} of {count + len(certificate.missing)} stages")


def stage_rows(edited: EditedJob, now: int | None) -> str:
    """Return a line for each stage, of which one is `now`; a click leads to where it begins."""
    assert edited.scene.job is not None
    stages = () if edited.shown is None else edited.shown.certificate.stages
    lines = [_row(number, stage, number == now) for number, stage in enumerate(stages)]
    for number, name in enumerate(edited.scene.job.names[len(stages) :], len(stages)):
        lines.append(_line(str(number + 1), name, "no motion yet"))
    return f'<div class="hd" style="padding:0 0.6em">{"".join(lines)}</div>'


def _row(number: int, stage: StageCertificate, now: bool) -> str:
    certificate = stage.certificate
    tint, mark = ("hd-good", "✓") if certificate.certified else ("hd-bad", "✕")
    words = [SHORT[certificate.status]]
    if certificate.certified and certificate.clearance is not None and stage.scene.obstacles:
        words.append(proven_length(certificate.clearance))
    held = f"holds {', '.join(stage.held)}" if stage.held else "holds nothing"
    touch = f"<br/>may touch: {html.escape(', '.join(' – '.join(pair) for pair in stage.touch))}" if stage.touch else ""
    line = _line(f"{stage.begins:.2f} s", stage.name, " · ".join(words), mark, tint, now, telling("stage", to=number))
    text = f"{html.escape(certificate.text)}<br/>{html.escape(held)}{touch}"
    return f'<details>{line}<div style="padding:0.2em 0.3em 0.5em 1.6em">{text}</div></details>'


def _line(first: str, name: str, text: str, mark: str = "", tint: str = "", now: bool = False, do: str = "") -> str:
    # A stage without a motion leads nowhere, and does not look as if it did.
    kind, tell = ("summary", f' role="button" data-do="{do}"') if do else ("div", "")
    style = "hd-row" if do else "hd-row hd-still"
    return (
        f'<{kind} class="{style}{" hd-chosen" if now else ""}"{tell}>'
        f'<span style="min-width:3.6em;text-align:right;font-variant-numeric:tabular-nums">{first}</span>'
        f'<span class="{tint}" style="min-width:1em">{mark}</span>'
        f'<b class="hd-line" style="flex:1" title="{html.escape(name)}">{html.escape(name)}</b>'
        f'<span class="hd-line {tint}">{html.escape(text)}</span></{kind}>'
    )


def held_words(edited: EditedJob, number: int | None) -> str:
    """Say which stage there is, and what is held in it."""
    if edited.shown is None or number is None:
        return ""
    stage = edited.shown.certificate.stages[number]
    held = ", ".join(stage.held) or "nothing"
    return f'<div class="hd hd-line">{html.escape(f"stage {number + 1}, {stage.name}: holds {held}")}</div>'


def job_legend(edited: EditedJob) -> str:
    """Say what the colours of the path mean."""
    if edited.shown is None:
        return ""
    certificate = edited.shown.motion.certificate
    if certificate.certified:
        return clearance_legend()
    return color_legend(verdict_color(certificate), SHORT[certificate.status])
