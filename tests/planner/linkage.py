"""An arm like those that lift by a parallel linkage (a cylinder beside the upper arm, rods beside the elbow), and the
same arm whose followers are joints like any other."""

from __future__ import annotations

from pathlib import Path

JOINTS = ("turn", "lift", "elbow", "roll", "bend")
RULES = {  # follower -> (followed, multiplier, offset)
    "cylinder": ("lift", -0.25, 0.0),
    "piston": ("cylinder", 5.0, 0.1),  # a chain: -1.25 lift + 0.1
    "rod": ("elbow", -1.0, 0.0),
    "slide": ("elbow", 0.05, 0.02),
}
LINKS = {  # link -> (parent, joint, kind, place, axis, limits, box, where it is)
    "shoulder": ("base", "turn", "revolute", "0 0 0.5", "0 0 1", "-2.9 2.9", "0.3 0.3 0.2", "0 0 0"),
    "upper": ("shoulder", "lift", "revolute", "0.2 0 0.1", "0 1 0", "-1.1 1.4", "0.12 0.12 0.6", "0 0 0.4"),
    "barrel": ("shoulder", "cylinder", "continuous", "-0.25 0.3 0", "0 1 0", "", "0.1 0.1 0.4", "0 0 0.25"),
    "stem": ("upper", "piston", "continuous", "-0.1 0.3 0", "0 1 0", "", "0.06 0.06 0.3", "0 0 -0.2"),
    "fore": ("upper", "elbow", "revolute", "0 0 0.8", "0 1 0", "-2.5 1.2", "0.5 0.12 0.12", "0.35 0 0"),
    "bar": ("upper", "rod", "continuous", "0 -0.3 0", "0 1 0", "", "0.4 0.05 0.05", "-0.3 0 0"),
    "sled": ("fore", "slide", "prismatic", "0.3 0 0.15", "1 0 0", "-0.07 0.09", "0.1 0.1 0.08", "0 0 0"),
    "wrist": ("fore", "roll", "continuous", "0.7 0 0", "1 0 0", "", "0.12 0.08 0.08", "0.08 0 0"),
    "hand": ("wrist", "bend", "revolute", "0.2 0 0", "0 1 0", "-2 2", "0.15 0.06 0.06", "0.1 0 0"),
}


def linkage_urdf(folder: Path, follow: bool = True, **rules: tuple[str, float, float]) -> Path:
    """Write the arm, with other rules in place of some; without `follow` the followers are ordinary joints."""
    wanted, lines = {**RULES, **rules}, ['<robot name="lifter">', '<link name="base"/>']
    for link, (parent, joint, kind, place, axis, limits, box, at) in LINKS.items():
        shape = f'<collision><origin xyz="{at}"/><geometry><box size="{box}"/></geometry></collision>'
        lines.append(f'<link name="{link}">{shape}</link>')
        content = f'<origin xyz="{place}"/><parent link="{parent}"/><child link="{link}"/><axis xyz="{axis}"/>'
        if limits:
            low, high = limits.split()
            content += f'<limit lower="{low}" upper="{high}" velocity="1.5" effort="100"/>'
        else:
            content += '<limit velocity="3" effort="100"/>' * (joint not in RULES)
        if follow and joint in wanted:
            followed, factor, offset = wanted[joint]
            content += f'<mimic joint="{followed}" multiplier="{factor!r}" offset="{offset!r}"/>'
        lines.append(f'<joint name="{joint}" type="{kind}">{content}</joint>')
    file = folder / ("lifter.urdf" if follow else "free.urdf")
    file.write_text("\n".join([*lines, "</robot>"]))
    return file
