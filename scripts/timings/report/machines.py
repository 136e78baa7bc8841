"""The machines in the report, each with a folder of results' files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cl import InputError
from timings.results import Results, read_results

#: The comparison that may be the only one of a machine.
BATCH = "batch"


@dataclass(frozen=True, eq=False)
class Machine:
    """A machine of the report. name: of the folder. title: from the devices in the results.
    results: by comparison."""

    name: str
    title: str
    results: Mapping[str, Results]


def read_machines(folders: list[Path]) -> list[Machine]:
    """Read a machine from each folder that holds results other than `batch` alone. Raises
    InputError if there is none, or one without the results of `compare_timings.py whole`, on which
    the report is based."""
    machines = []
    for folder in folders:
        results = _read_results(folder)
        if set(results) <= {BATCH}:
            continue
        if "whole" not in results or not results["whole"].starting("column "):
            raise InputError(f"{folder}: no columns in whole.json; expected results of `whole`")
        machines.append(Machine(folder.name, _title(results), results))
    if not machines:
        shown = ", ".join(str(folder) for folder in folders) or "no folder"
        raise InputError(f"{shown}: no results; expected *.json of compare_timings.py")
    # The machine with the fewest devices first: pages proceed from small to large.
    return sorted(machines, key=lambda m: len(_environment(m.results)["devices"]))


def read_batches(folders: list[Path]) -> list[Machine]:
    """Read a machine from each folder that holds results of `compare_timings.py batch`."""
    found = [(folder, _read_results(folder)) for folder in folders]
    return [Machine(path.name, _title(of), of) for path, of in found if BATCH in of]


def _read_results(folder: Path) -> dict[str, Results]:
    return {file.stem: read_results(file) for file in sorted(folder.glob("*.json"))}


def _environment(results: Mapping[str, Results]) -> dict[str, Any]:
    return results["whole" if "whole" in results else BATCH].environment


def _title(results: Mapping[str, Results]) -> str:
    machine = _environment(results)
    gpus = [device["name"] for device in machine["devices"] if device["kind"] == "gpu"]
    units = [d["compute_units"] for d in machine["devices"] if d["kind"] == "cpu"]
    cores = max(units, default=machine["cores"])
    cpu = f"{short_cpu(machine['cpu'])}, {cores} core{'s' * (cores > 1)}"
    counted = [f"{n} x {name}" if n > 1 else name for name, n in Counter(gpus).items()]
    return " with ".join([*counted, cpu])


def short_cpu(name: str) -> str:
    """Return a processor's name without trademark signs and the like."""
    for noise in ("(R)", "(TM)", " CPU", " Processor"):
        name = name.replace(noise, "")
    return " ".join(name.split("@")[0].split())


def missing(machine: Machine, comparison: str, *prefixes: str, always: bool = True) -> list[str]:
    """Return Markdown that names the missing sections of the comparison whose names begin so.

    always: also report if there is no such section at all.
    """
    results = machine.results.get(comparison)
    if results is None:
        return [f"_Missing: {machine.title}: `compare_timings.py {comparison}` was not run._"]
    lines = []
    for prefix in prefixes:
        left_out = {k: v for k, v in results.left_out.items() if k.startswith(prefix)}
        lines += [
            f"_Missing: {machine.title}: {comparison}, {name_processors(name, machine)}: {reason}._"
            for name, reason in left_out.items()
        ]
        if always and not left_out and not results.starting(prefix):
            lines.append(
                f"_Missing: {machine.title}: {comparison}, {prefix.strip()}: not in the results, "
                "which an older program wrote, or one that was ended._"
            )
    return lines


def device_title(label: str, machine: Machine) -> str:
    """Return the name of a place for pages: PoCL's names mention neither OpenCL nor CPU."""
    if label.startswith(("pthread", "cpu-")):
        cores = label.rsplit(", ", 1)[-1]
        return f"{short_cpu(_environment(machine.results)['cpu'])}, {cores}"
    return label


def name_processors(text: str, machine: Machine) -> str:
    """Return `text` with processors' own names instead of PoCL's."""
    about = _environment(machine.results)
    for device in about["devices"]:
        if device["kind"] == "cpu":
            text = text.replace(device["name"], short_cpu(about["cpu"]))
    return text
