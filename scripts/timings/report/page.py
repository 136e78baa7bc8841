"""The report: Markdown from results' files."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np

from apf.body import load_body
from psfs.common.files import write_text
from timings.report import curves, figures, laws, limits, peers, rymut
from timings.report.machines import BATCH, Machine, device_title, missing, name_processors
from timings.tables.batch import make_tables
from timings.tables.grid import Grid, number
from timings.tables.whole import (
    columns,
    cues_table,
    later,
    median_ms,
    papers,
    song_table,
    stage_table,
    stream_table,
    streams,
    surface_table,
    table_2,
    table_3,
    table_4,
)

FIGURES = "figures"


def write_report(
    machines: Sequence[Machine], folder: Path, batches: Sequence[Machine] = ()
) -> None:
    """Write report.md and figures/*.svg to `folder`.
    batches: the machines with timed takes."""
    draw: dict[str, Callable[[Sequence[Machine]], Any]] = {
        "headline": figures.headline, "per_frame": figures.per_frame, "stages": figures.stages,
        "amdahl": limits.amdahl, "roofline": limits.roofline, "scaling": limits.scaling,
        "swarm_curves": curves.swarm,
        "objective_shares": curves.shares, "work_groups": curves.groups, "online": curves.online,
    }  # fmt: skip
    drawn = set()
    for name, make in draw.items():
        made = make(machines)
        if made is not None:
            figures.write_figure(made, folder / FIGURES / f"{name}.svg")
            drawn.add(name)
    write_text(folder / "report.md", page(machines, drawn, batches))


def page(machines: Sequence[Machine], drawn: Set[str], batches: Sequence[Machine] = ()) -> str:
    """Return the report's Markdown, with the figures that were drawn."""
    parts = [_opening(machines), _machines(machines), _song(machines), _where_time_goes(machines)]
    more = [machine for machine in batches if machine.name not in {m.name for m in machines}]
    parts += [_growth(machines), peers.peers(machines), rymut.tables(machines)]
    parts += [_takes(machines, batches), _left_out([*machines, *more])]

    def kept(found: re.Match[str]) -> str:
        return found[0] if found[1] in drawn else "_Not measured._"

    text = "\n\n".join(part for part in parts if part) + "\n"
    return re.sub(rf"!\[[^]]*\]\({FIGURES}/(\w+)\.svg\)", kept, text)


def figure(name: str, alt: str) -> str:
    return f"![{alt}]({FIGURES}/{name}.svg)"


def _opening(machines: Sequence[Machine]) -> str:
    settings = machines[0].results["whole"].settings
    nx, ny, nz = settings["shape"]
    lead, config = headline_sentences(machines), settings["filter"]
    return f"""# OpenCL against the CPU: timings of psfs-apf

One command per machine and comparison (below, with its day and commit) measures the programs of a
table in the same minutes: the NumPy twins on one thread, the OpenCL kernels on one core and on all
cores of the CPU (through PoCL), and on the GPU, in the
setting of Song et al. 2012: {settings["views"]} cameras of 640 x 480 pixels, {nx} x {ny} x {nz}
voxels, {config["n_particles"]} particles, {config["n_layers"]} layers. A frame goes from its
pictures in host memory to the pose and the coloured surface voxels in host memory.

{lead}

{figure("headline", "Milliseconds per frame on every device, beside Song et al.")}

Everything on this page is made by `scripts/report_timings.py` from the files under
`scripts/results/`, which hold all raw samples; only the papers' own figures were typed
(`scripts/timings/tables/papers.json`). The same on another machine:

```sh
python scripts/compare_timings.py all -o scripts/results/NAME
python scripts/report_timings.py
```

`--quick` takes two minutes, `--seconds S` starts nothing more after so many, and `--resume`
measures what is still missing; what was planned and not measured is named where it would stand."""


#: The columns that the fastest is compared with, and the most similar ratio in Song et al.
_COMPARED = {"one": "GPU / CPU", "cpu": "GPU / CPU+TBB (4 cores)", "numpy": None}


def headline_sentences(machines: Sequence[Machine]) -> str:
    """Return sentences on the fastest machine's whole frame: against one core of the same code,
    against all cores, and against the twin."""
    machine = machines[-1]
    by_kind = {figures.column_kind(column): (title, column)
               for title, column in columns(machine.results["whole"])}  # fmt: skip
    best = by_kind.get("gpu") or by_kind.get("cpu") or by_kind["one"]
    ms = median_ms(best[1])
    sentences = [f"**{machine.title}**: a whole frame takes {number(ms)} ms on {best[0]}"]
    song = {name: final for name, _, final in papers()["song2012"]["tables"]["3"]["rows"]}
    for kind, name in _COMPARED.items():
        if kind in by_kind and by_kind[kind] is not best:
            title, column = by_kind[kind]
            theirs = f" (Song et al., {name}: {song[name]:.0f} x)" if name in song else ""
            beside = theirs if "gpu" in by_kind else ""
            sentences.append(f"{number(median_ms(column) / ms)} x as fast as {title}{beside}")
    return ", ".join(sentences) + ". Medians."


def _machines(machines: Sequence[Machine]) -> str:
    rows = []
    for machine in machines:
        results = machine.results["whole"]
        about = results.environment
        devices = "; ".join(
            f"{d['name']} ({d['platform']}, {d['driver']})" for d in about["devices"]
        )
        packages = about["packages"]
        shown = ("numpy", "pyopencl", "pocl-binary-distribution", "open3d")
        versions = ", ".join(f"{name} {packages.get(name) or 'absent'}" for name in shown)
        rows.append([
            machine.title, about["cpu"], devices, f"Python {about['python']}, {versions}",
            _describe_measurement(machine), f"{about['load']:.1f}",
            f"`{results.command}`",
        ])  # fmt: skip
    heads = ["machine", "CPU", "OpenCL devices (platform, driver)", "versions", "measured",
             "load before", "command"]  # fmt: skip
    turned = [
        [head, *cells] for head, *cells in zip(heads[1:], *(r[1:] for r in rows), strict=True)
    ]
    grid = Grid("What was measured on", ["", *(row[0] for row in rows)], turned)
    return "## Machines\n\n" + grid.markdown()


def _describe_measurement(machine: Machine) -> str:
    """Return date and commit of the measurements, with the comparisons' names if they differ."""
    stated: dict[str, list[str]] = {}
    for name, results in machine.results.items():
        stated.setdefault(f"{results.made[:10]}, commit {results.commit}", []).append(name)
    if len(stated) == 1:
        return next(iter(stated))
    return "; ".join(f"{', '.join(names)}: {when}" for when, names in stated.items())


def _song(machines: Sequence[Machine]) -> str:
    song = papers()["song2012"]
    parts = [
        "## The tables of Song et al.", f"{song['citation']}. Theirs: {song['setting']}.",
        "### Song table 1", _table_1().markdown(), "### Song table 2",
    ]  # fmt: skip
    each = [(machine, machine.results["whole"]) for machine in machines]
    for machine, results in each:
        parts += [table_2(results, machine.title).markdown(), *missing(machine, "whole", "column ")]
    for machine, results in each:
        finer = surface_table(results, machine.title)
        parts += [name_processors(finer.markdown(), machine)] if finer else []
        parts += missing(machine, "whole", "surface ")
    parts += [
        stream_table(results, machine.title).markdown()
        for machine, results in each
        if streams(results)
    ]
    for machine, results in each:
        # in a file of its own where it was measured later than the rest
        own = song_table(machine.results.get("song", results), machine.title)
        parts += (
            [name_processors(own.markdown(), machine)]
            if own
            else missing(machine, "whole", "song ")
        )
        cues = cues_table(results, machine.title)
        parts += [name_processors(cues.markdown(), machine)] if cues else []
        parts += missing(machine, "whole", "cues ")
    parts += ["### Song table 3"]
    parts += [table_3(results, machine.title).markdown() for machine, results in each]
    parts += ["### Song table 4", figure("per_frame", "Time of each frame, ours and Song's")]
    for machine, results in each:
        parts += [
            f"<details><summary>{machine.title}: all frames of all runs, beside Song's</summary>",
            table_4(results).markdown(), "</details>",
        ]  # fmt: skip
    return "\n\n".join(parts)


def _table_1() -> Grid:
    cones = load_body("song31").cones
    seen = [cone for cone in cones if cone.in_images]
    rows = []
    for (place, part), cone in zip(papers()["song2012"]["tables"]["1"]["rows"], seen, strict=True):
        length = float(np.linalg.norm(cone.end - cone.start))
        radii = " to ".join(f"{100 * r:.1f}" for r in cone.radii)
        rows.append([str(place), part, f"`{cone.name}`", f"{100 * length:.0f}", radii])
    more = ", ".join(f"`{cone.name}`" for cone in cones if not cone.in_images)
    return Grid(
        "The 10 cylinders of the human body, 31 degrees of freedom",
        ["cylinder", "Song et al.", "ours (body `song31`)", "length, cm", "radii, cm"], rows,
        f"Before they are fitted to a person. {more} account for voxels only.",
    )  # fmt: skip


def _where_time_goes(machines: Sequence[Machine]) -> str:
    parts = ["## Where the time goes", figure("stages", "Share of every stage on every device")]
    for machine in machines:
        for section in machine.results["whole"].starting("stages "):
            titled = {**section, "label": device_title(section["label"], machine)}
            parts.append(stage_table(titled).markdown())
        parts += missing(machine, "whole", "stages ")
    parts += [_numpy_parts(machines), "### Roofline", _ROOFLINE, figure("roofline", "Rooflines")]
    parts += ["### Amdahl", _AMDAHL, figure("amdahl", "Speed-up over cores")]
    for grid in (laws.core_laws(machines), laws.little(machines)):
        parts += [grid.markdown()] if grid else []
    for machine in machines:
        parts += missing(machine, "whole", "cores ", always=False)
    parts.append(_waiting(machines).markdown())
    for machine in machines:
        parts += missing(machine, "whole", "compilation ")
    return "\n\n".join(part for part in parts if part)


_ROOFLINE = """A stage under the sloping line moves bytes more slowly than a plain copy does, one
under the level line computes more slowly than plain multiply-adds do. Bytes and operations are
counted for the plain algorithm (`scripts/timings/stages.py`), so that a stage which skips work, as
occupancy does, can lie above."""
_AMDAHL = """Fitted to the whole frames' times: the share that does not get faster with cores."""


def _numpy_parts(machines: Sequence[Machine]) -> str:
    """Return NumPy's three parts beside those of the devices of the same machine."""
    grids = []
    for machine in machines:
        results = machine.results["whole"]
        twin = results.sections.get("column NumPy")
        if not twin:
            continue
        numpy_ms = {part: float(np.median([ms for run in twin["runs"]
                                         for ms in later(run["parts"][part])]))
                    for part in twin["runs"][0]["parts"]}  # fmt: skip
        sections = results.starting("stages ")
        heads = [device_title(section["label"], machine) for section in sections]
        rows = []
        for part, ms in numpy_ms.items():
            row = [part, number(ms)]
            for section in sections:
                mine = figures.part_ms(section["stages"], part)
                row += [number(mine), f"{number(ms / mine)} x"]
            rows.append(row)
        wide = [cell for head in heads for cell in (f"{head}, ms", "NumPy : it")]
        grids.append(Grid(f"Parts of a frame, {machine.title}",
                          ["part", "NumPy, ms", *wide], rows).markdown())  # fmt: skip
    return "\n\n".join(grids)


def _waiting(machines: Sequence[Machine]) -> Grid:
    """Return whole frames beside the device's busy time, streaming, setup, and the first frame."""
    rows = []
    for machine in machines:
        results = machine.results["whole"]
        for title, column in columns(results):
            if column["kind"] == "numpy":
                continue
            stages = results.sections.get(f"stages {column['label']}")
            busy = stages and sum(timing.median for timing in stages["stages"].values())
            built = results.sections.get(f"compilation {column['label']}") or {}
            rows.append([
                f"{machine.title}: {title}", number(median_ms(column)), number(busy),
                number(_find_streamed(column)), number(column["first_frame_ms"]),
                number(column["setup_ms"]), number(built.get("empty")), number(built.get("filled")),
            ])  # fmt: skip
    return Grid(
        "Warm-up, compilation and waiting, ms",
        ["device", "whole frame", "device busy", "streamed, per frame", "first frame",
         "making it", "new machine", "next time"], rows,
        "Streamed: the next frame is uploaded while this one is computed, coloured voxels and "
        "pose are downloaded. Making it: buffers and "
        "kernels, from the compilers' caches. New machine and next time: making it and the first "
        "frame in a fresh process with the compilers' caches empty and filled.",
    )  # fmt: skip


def _find_streamed(column: Any) -> float | None:
    """Return the median time, ms, of a streamed frame with coloured voxels downloaded."""
    return column["to_cloud"]["frames"].median if "to_cloud" in column else None


def _growth(machines: Sequence[Machine]) -> str:
    return "\n\n".join([
        "## Growth",
        "One setting varies, all others stay Song et al.'s; medians of whole frames.",
        figure("scaling", "Time of a frame over voxels, cameras, particles, layers"),
        *(line for machine in machines for line in missing(machine, "whole", "scaling ")),
    ])  # fmt: skip


def _takes(machines: Sequence[Machine], batches: Sequence[Machine]) -> str:
    """Return takes per minute, machine by machine."""
    parts = ["## Many takes", _TAKES]
    for machine in batches:
        results = machine.results[BATCH]
        about = f"{results.made[:10]}, commit {results.commit}; `{results.command}`; "
        about += f"takes begin {results.settings.get('begin', 'all at once')}."
        parts += [f"### {machine.title}", about, *(g.markdown() for g in make_tables(results))]
        parts += missing(machine, BATCH, "workers ", "decoding")
    counted = {machine.name for machine in batches}
    for machine in machines:
        parts += [] if machine.name in counted else missing(machine, BATCH)
    return "\n\n".join(parts)


_TAKES = """Takes done by the tasks of `apf batch`: read, reconstructed, tracked and written.
Speed-up and efficiency are against the first row; core s: of the processor, all processes
together. Where takes begin one after another, those are counted that end while all workers are
busy. Takes of one length that begin all at once keep in step: all look at their footage, with the
GPUs idle, and then wait for each other's tracking."""


def _left_out(machines: Sequence[Machine]) -> str:
    rows = [
        [machine.title, name, name_processors(section, machine), reason]
        for machine in machines
        for name, results in machine.results.items()
        for section, reason in results.left_out.items()
    ]
    if not rows:
        return ""
    grid = Grid("Not measured", ["machine", "comparison", "section", "reason"], rows)
    return "## What is missing\n\n" + grid.markdown()
