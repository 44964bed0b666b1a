"""Sources become problems: in order, by names that differ, each with a seed of its own; what is wrong is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan import InputError, load_scene
from hdplan.planner.batch.job import Job, seed_of
from hdplan.planner.batch.sources import jobs_of
from hdplan.planner.batch.tables import table_bytes
from hdplan.scenes.yaml_format.writer import scene_text

HEAD = "name,group,seed,start.joints.shoulder,start.joints.elbow,goal.joints.shoulder,goal.joints.elbow"


def write(name: str, text: str = "hdplan: 1\n") -> None:
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    Path(name).write_text(text, encoding="utf-8")


def refused(sources: list[str], *words: str, scene: str | None = None) -> None:
    with pytest.raises(InputError) as caught:
        jobs_of(sources, scene)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


def test_folders_are_searched_for_pairs_and_scenes() -> None:
    for name in ("a/robot.yaml", "a/b/scene1.yaml", "a/b/request1.yaml", "a/b/scene2.yaml", "a/lone.yaml", "a/x.txt"):
        write(name)
    jobs = jobs_of(["a"])
    assert [(job.name, job.group) for job in jobs] == [("b/scene1", "b"), ("b/scene2", "b"), ("lone", "")]
    pair, single, _ = jobs
    assert (pair.request, pair.robot) == (Path("a/b/request1.yaml").absolute(), Path("a/robot.yaml").absolute())
    assert (single.request, single.robot) == (None, None)


def test_links_that_lead_nowhere_are_problems_that_say_so() -> None:
    write("a/one.yaml")
    for link in ("a/gone.yaml", "a/shelf", "a/readme.txt"):
        Path(link).symlink_to("nowhere")
    jobs = jobs_of(["a"])
    assert [job.name for job in jobs] == ["gone", "one", "shelf"]
    assert {job.name for job in jobs_of(["a/*.yaml"])} == {"a/gone", "a/one"}
    for job in jobs:
        if job.name != "one":
            with pytest.raises(InputError, match=f"a/{job.name}.* is a link to nowhere, which does not exist$"):
                job.load()
            assert job.hashed == ""


def test_names_of_several_folders_differ() -> None:
    write("a/one.yaml"), write("b/one.yaml")
    assert [job.name for job in jobs_of(["a", "b"])] == ["a/one", "b/one"]


def test_patterns_files_and_shipped_names() -> None:
    write("x2.yaml"), write("x1.yaml"), write("y.yaml")
    assert [job.name for job in jobs_of(["x*.yaml", "y.yaml", "planar_arm"])] == ["x1", "x2", "y", "planar_arm"]


def test_seeds_are_each_problems_own_whatever_the_others_are() -> None:
    write("a.yaml"), write("b.yaml")
    alone, (_, beside) = jobs_of(["b.yaml"], seed=7), jobs_of(["a.yaml", "b.yaml"], seed=7)
    assert alone[0].seed == beside.seed == seed_of(7, "b") != seed_of(7, "a")
    assert seed_of(0, "b") == 0


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_tables_vary_a_scene(ending: str) -> None:
    rows = [
        {"name": "one", "group": "g", "seed": 5, "start.joints.shoulder": 0.25, "planner.waypoints": 16},
        {"start.joints.shoulder": -1, "start.joints.elbow": 0.5},
    ]
    if ending == ".parquet":
        Path("t.parquet").write_bytes(table_bytes(rows))
    else:
        write("t.csv", "name,group,seed,start.joints.shoulder,start.joints.elbow,planner.waypoints\n"
              "one,g,5,0.25,,16\n,,,-1,0.5,\n")  # fmt: skip
    one, two = jobs_of(["t" + ending], "planar_arm")
    assert (one.name, one.group, one.seed) == ("one", "g", 5)
    assert dict(one.fields) == {"start.joints.shoulder": 0.25, "planner.waypoints": 16}
    assert (two.name, two.group, two.seed) == ("t/000001", "planar_arm", 0)
    assert dict(two.fields) == {"start.joints.shoulder": -1, "start.joints.elbow": 0.5}
    assert one.load().planner.waypoints == 16


def test_invalid_sources_are_refused_at_once() -> None:
    write("empty/readme.txt"), write("a/one.yaml"), write("t.csv", f"{HEAD}\n")
    Path("cut.parquet").write_bytes(table_bytes([{"seed": 1}])[:-9])
    refused(["nowhere/*.yaml"], "nowhere/*.yaml", "no such file")
    refused(["empty"], "empty", "no scene files")
    refused(["a", "a"], "2 problems", "a/one")
    refused(["planar_arm"], "--scene panda_cage", scene="panda_cage")
    refused(["t.csv"], "t.csv", "--scene")
    refused(["t.csv"], "panda_cag", "'panda_cage'", scene="panda_cag")
    refused(["t.csv"], "no rows", scene="planar_arm")
    refused(["no.csv"], "no.csv: no such file", scene="planar_arm")
    refused(["no.parquet"], "no.parquet: no such file", scene="planar_arm")
    refused(["cut.parquet"], "cut.parquet: is not a Parquet table", scene="planar_arm")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["first line"]),
        ("a,a\n1,2\n", ["first line", "name of its own"]),
        ("seed,\n1,2\n", ["first line"]),
        (f"{HEAD}\n1,2\n", ["row 0", "2 values", "names 7"]),
        ("seed\n1.5\n", ["row 0: seed", "'1.5'"]),
        ("seed\n-1\n", ["row 0: seed", "'-1'"]),
        ("seed\n1_0\n", ["row 0: seed", "'1_0'"]),
        ("seed;name\n1;a\n", ["line 1: has semicolons"]),
        ("strat.joints.joint1\n1\n", ["'strat.joints.joint1'", "'start'"]),
        ('seed\n"1\n', ["is not a CSV table"]),
        ("seed\n\x00\n", ["t.csv"]),
    ],
)
def test_a_broken_table_is_refused(text: str, words: list[str]) -> None:
    write("t.csv", text)
    refused(["t.csv"], "t.csv", *words, scene="planar_arm")


def test_the_hash_is_that_of_what_is_read() -> None:
    scene = load_scene("planar_arm")
    write("one.yaml", scene_text(scene))
    job = Job("x", "", Path("one.yaml"))
    assert job.hashed == Job("y", "z", Path("one.yaml"), seed=3).hashed != Job("x", "", Path("planar_arm")).hashed
    assert job.hashed != Job("x", "", Path("one.yaml"), fields=(("start", "default"),)).hashed
    write("one.yaml", scene_text(scene) + "# more\n")
    assert job.hashed != Job("x", "", scene).hashed == Job("y", "", load_scene("planar_arm")).hashed
    assert Job("x", "", Path("gone.yaml")).hashed == ""


def test_a_scenes_hash_tells_long_lists_apart() -> None:
    def cloud(last: float) -> Job:
        points = np.random.default_rng(0).uniform(0.5, 1.0, (500, 3))
        points[-1] = last
        obstacle = hdplan.Points(points)
        return Job("x", "", hdplan.Scene(robot="panda", obstacles=[obstacle], start="default", goal=[0.0] * 7))

    assert cloud(0.7).hashed == cloud(0.7).hashed != cloud(0.71).hashed


@pytest.mark.parametrize("quoted", ["{}", '"{}"', "'{}'"])
@pytest.mark.parametrize("key", ["file", '"file"'])
def test_the_hash_is_also_that_of_the_files_that_are_named(quoted: str, key: str) -> None:
    """A cloud or a mesh that was written again is another problem; reading it is left to the one who solves it."""
    entry = f"- {{name: view, cloud: {{{key}: {quoted.format('my scan.xyz')}, radius: 0.01}}}}"
    ends = "start: {state: default}\ngoal: {state: default}\n"
    write("one.yaml", f"hdplan: 1\nrobot: {{name: panda}}\nobstacles:\n  {entry}\n{ends}")
    write("my scan.xyz", "0 0 2\n")
    by_file = Job("x", "", Path("one.yaml").absolute())
    made = Job("x", "", load_scene("one.yaml"))
    before = by_file.hashed, made.hashed
    assert before == (by_file.hashed, made.hashed)
    write("my scan.xyz", "0 0 3\n1 1 3\n")
    after = by_file.hashed, made.hashed
    assert before[0] != after[0]
    assert before[1] != after[1]
    Path("my scan.xyz").unlink()
    assert by_file.hashed not in ("", before[0], after[0])
