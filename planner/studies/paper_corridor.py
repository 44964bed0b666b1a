"""The paper's robot experiment, measured: CSV, PNG and a report, as `paper_figures` does for the other figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdplan.planner.certificate.verdict import proven_length
from hdplan.planner.control.look_ahead import Mode
from hdplan.planner.studies.corridor_experiment import (
    AS_SAFE,
    CRITICAL_PHASE,
    DURATION,
    EXACT_EVERY,
    NAMES,
    SWEPT,
    VARIANTS,
    Outcome,
    run_variant,
    sweep,
)
from hdplan.planner.studies.report import (
    Cell,
    Report,
    Reporter,
    Stopper,
    check_report,
    csv_text,
    png,
    short,
    write_report,
)

PUBLISHED = 35.0  # [s] after which the published run ends


def reproduce_corridor(folder: Path, quick: bool, report: Reporter, stop: Stopper) -> Report:
    """Run the paper's robot experiment under each distance, and change one setting at a time; for ``quick`` the first
    seconds alone, without the changes."""
    pictures = ("corridor.png", "corridor_arm.png", "corridor_witnesses.png")
    names = ("corridor.csv", "corridor_commands.csv", *pictures, *(() if quick else ("corridor_settings.csv",)))
    paths = check_report(folder, names)
    changes = () if quick else sweep()
    total = len(VARIANTS) + len(changes)
    outcomes: list[Outcome] = []
    for variant in VARIANTS:
        report(len(outcomes), total, variant.name)
        if stop():
            break
        outcomes.append(run_variant(variant, CRITICAL_PHASE if quick else DURATION))
    if not outcomes:
        raise KeyboardInterrupt
    changed: list[tuple[str, Outcome]] = []
    for words, variant in changes:
        report(len(VARIANTS) + len(changed), total, words)
        if stop():
            break
        changed.append((words, run_variant(variant, SWEPT)))
    from hdplan.planner.studies.corridor_sheet import corridor_sheet
    from hdplan.planner.studies.corridor_snapshots import arm_sheet, witness_sheet

    lines = [_corridor_line(outcome) for outcome in outcomes]
    steps = len(outcomes[0].run.velocities[: round(CRITICAL_PHASE / outcomes[0].run.period)])
    commands: list[dict[str, Cell]] = [
        {"time_s": outcomes[0].run.period * k, **{o.variant.name: float(o.run.velocities[k, -1]) for o in outcomes}}
        for k in range(steps)
    ]
    settings: list[dict[str, Cell]] = [_setting_line(words, outcome) for words, outcome in changed]
    arm = next((each for each in outcomes if each.variant.name == AS_SAFE), outcomes[0])
    sheets = (corridor_sheet(outcomes), arm_sheet(arm), witness_sheet(outcomes[0]))
    contents: list[str | bytes] = [csv_text(lines), csv_text(commands), *map(png, sheets)]
    write_report(paths, [*contents, *([csv_text(settings)] if settings else [])])
    shown: list[dict[str, Cell]] = [
        {
            "distance": outcome.variant.name,
            "variation [rad/s]": short(outcome.variation(CRITICAL_PHASE, -1)),
            "all joints": short(outcome.variation(CRITICAL_PHASE)),
            "> 5 Hz [rad²/s]": f"{outcome.energy(CRITICAL_PHASE, -1):.1e}",
            "jumps [1/s]": short(outcome.jump_rate(CRITICAL_PHASE)),
            "boxes [mm]": short(1e3 * float(outcome.clearances.min())),
            "meshes [mm]": short(1e3 * outcome.mesh_clearance),
            "links [mm]": short(1e3 * float(outcome.between_links.min())),
            "target [s]": short(outcome.reached),
            "step [ms]": short(1e3 * float(np.median(outcome.run.step_seconds))),
            "rule": _rule(outcome),
        }
        for outcome in outcomes
    ]
    tables: dict[str, list[dict[str, Cell]]] = {
        f"the first {CRITICAL_PHASE:g} s of the last joint, and the whole run's clearance": shown
    }
    if settings:
        tables[f"one setting changed, {SWEPT:g} s"] = [
            {key: short(cell) for key, cell in line.items()} for line in settings
        ]
    notes = [
        (
            "boxes, meshes, links",
            "least exact distance: links' boxes to the walls, real meshes to the walls, between links",
        ),
        ("jumps", "periods in which the point where the nearest pair's barrier acts moved by more than 2 cm"),
        ("rule", "what the controller's rule says of the margin: clearance proven at samples, or why it is refused"),
        ("the boxes", "are the paper's, most of them narrower than the links: they can be free where the meshes touch"),
    ]
    by_name = dict(zip(NAMES, outcomes, strict=False))
    if AS_SAFE in by_name:
        exact, smooth = by_name["Euclidean"], by_name[AS_SAFE]
        ratio = exact.variation(CRITICAL_PHASE, -1) / smooth.variation(CRITICAL_PHASE, -1)
        every = exact.variation(CRITICAL_PHASE) / smooth.variation(CRITICAL_PHASE)
        notes.insert(0, (
            "claim", f"total variation {ratio:.0f} times lower with the HD-SDF (all joints: {every:.0f} times), at "
            f"{1e3 * smooth.clearances.min():.1f} mm of least clearance against {1e3 * exact.clearances.min():.1f} mm",
        ))  # fmt: skip
    return Report(tables, notes, paths, len(outcomes) + len(changed) == total)


def _rule(outcome: Outcome) -> str:
    if outcome.variant.refused:
        return "refused"
    clearance = outcome.variant.clearance
    if clearance is None:
        return "no proof"
    return proven_length(clearance) if clearance > 0 else "not proven"


def _corridor_line(outcome: Outcome) -> dict[str, Cell]:
    run, seconds = outcome.run, outcome.run.step_seconds
    clearance = outcome.variant.clearance
    return {
        "distance": outcome.variant.name,
        "variation_last_joint_rad_per_s": outcome.variation(CRITICAL_PHASE, -1),
        "variation_all_joints_rad_per_s": outcome.variation(CRITICAL_PHASE),
        "energy_above_5_hz_last_joint_rad2_per_s": outcome.energy(CRITICAL_PHASE, -1),
        "energy_above_5_hz_all_joints_rad2_per_s": outcome.energy(CRITICAL_PHASE),
        "jumps_per_s": outcome.jump_rate(CRITICAL_PHASE),
        "clearance_boxes_m": float(outcome.clearances.min()),
        "clearance_boxes_35_s_m": float(outcome.clearances[: round(PUBLISHED / EXACT_EVERY)].min()),
        "clearance_meshes_m": outcome.mesh_clearance,
        "clearance_between_links_m": float(outcome.between_links.min()),
        "proven_at_samples_m": clearance,
        "way_in_half_a_period_m": outcome.way,
        "least_slack_m": float(run.slacks.min()),
        "target_reached_s": outcome.reached,
        "steps_that_gave_way": run.modes.count(Mode.GIVING_WAY),
        "step_median_s": float(np.median(seconds)),
        "step_95_percent_s": float(np.quantile(seconds, 0.95)),
        "program_median_s": float(np.median(run.program_seconds)),
        "refused": outcome.variant.refused or "",
    }


def _setting_line(words: str, outcome: Outcome) -> dict[str, Cell]:
    clearance = outcome.variant.clearance
    proven = None if clearance is None or outcome.variant.refused else 1e3 * (clearance - outcome.way)
    return {
        "setting": words,
        "variation [rad/s]": outcome.variation(CRITICAL_PHASE, -1),
        "> 5 Hz [rad²/s]": float(f"{outcome.energy(CRITICAL_PHASE, -1):.2g}"),
        "boxes [mm]": 1e3 * float(outcome.clearances.min()),
        "slack [mm]": 1e3 * float(outcome.run.slacks.min()),
        "gave way [%]": 100.0 * float(np.mean([mode is Mode.GIVING_WAY for mode in outcome.run.modes])),
        "target off [mm]": 1e3 * outcome.missing,
        "proven [mm]": proven,
        "rule": "refused" if outcome.variant.refused else "safe" if proven is not None and proven > 0 else "not proven",
    }
