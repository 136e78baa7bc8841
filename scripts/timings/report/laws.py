"""The laws of parallel computing (Rymut 2016, 3.5 to 3.8) on whole frames over CPU cores."""

from __future__ import annotations

from collections.abc import Sequence

from timings.report.limits import core_times, serial_share
from timings.report.machines import Machine
from timings.tables.grid import Grid, number, ratio
from timings.tables.whole import columns, median_ms, streams

_CORES_NOTE = (
    "Amdahl: the speed-up at the serial share that fits all rows of a machine. Karp-Flatt: the "
    "serial share that this row alone would need, (1/S - 1/p) / (1 - 1/p); where it grows with the "
    "cores, what limits is not serial work but overhead, memory and waiting. Gustafson: p - s (p - "
    "1) with Amdahl's s: the speed-up of a frame whose parallel part is p times as large; this "
    "was not measured."
)
_LITTLE_NOTE = (
    "Little's law: frames under way at once = frames per second x seconds that each takes. A frame "
    "alone takes the shortest time that it can, so that the product is a lower limit."
)


def karp_flatt(speed_up: float, cores: int) -> float:
    """Return the serial share that a speed-up on p cores shows by experiment."""
    return (1 / speed_up - 1 / cores) / (1 - 1 / cores)


def core_laws(machines: Sequence[Machine]) -> Grid | None:
    """Return a row per machine and number of cores; None without measured cores."""
    rows = []
    for machine in machines:
        times = core_times(machine.results["whole"])
        if len(times) < 2 or times[0][0] != 1:
            continue
        share = serial_share(times)
        for cores, ms in times[1:]:
            gain = times[0][1] / ms
            serial = karp_flatt(gain, cores)
            scaled = cores - share * (cores - 1)
            rows.append([
                machine.title, f"OpenCL CPU, p = {cores} cores", number(ms), ratio(gain),
                f"{100 * gain / cores:.0f} %", ratio(1 / (share + (1 - share) / cores)),
                f"{100 * serial:.1f} %", ratio(scaled),
            ])  # fmt: skip
    heads = ["machine", "program", "ms", "speed-up S", "efficiency", "Amdahl",
             "Karp-Flatt e", "Gustafson"]  # fmt: skip
    return Grid("Laws of speed-up", heads, rows, _CORES_NOTE) if rows else None


def little(machines: Sequence[Machine]) -> Grid | None:
    """Return a row per machine and program whose frames were streamed; None without any."""
    rows = []
    for machine in machines:
        results = machine.results["whole"]
        alone = {title: median_ms(column) for title, column in columns(results)}
        for title, run in streams(results):
            own = alone[title.partition(", streamed")[0]]
            apart = run["frames"].median
            rows.append([
                machine.title, title, number(1e3 / apart), number(own), number(own / apart)
            ])  # fmt: skip
    heads = ["machine", "program", "streamed, frames/s", "a frame alone, ms", "frames under way"]
    return Grid("Little's law", heads, rows, _LITTLE_NOTE) if rows else None
