"""`psfs devices`: the OpenCL devices of this machine, and whether they work."""

from __future__ import annotations

import argparse

from rich.table import Table

from cl import DeviceInfo, list_devices, select_device
from psfs.cli.commandline import stdout, warn


def run(args: argparse.Namespace) -> None:
    devices = list_devices(afresh=True)
    if not devices:
        select_device()  # raises an error that names what to install
    stdout.print(_table(devices))
    broken = [info for info in devices if info.probe and info.probe.fault]
    if len(broken) == len(devices):
        select_device()  # raises an error with the faults of all devices
    for info in broken:
        assert info.probe is not None
        warn(f"{info.name} does not work: {info.probe.fault}", stdout)


def _table(devices: list[DeviceInfo]) -> Table:
    """Return a table of the devices with the results of trying them, the device of `auto` first."""
    table = Table("name", "kind", "platform", "driver", "works")
    for heading in ("compute units", "memory GiB", "GB/s", "GFLOP/s"):
        table.add_column(heading, justify="right")
    for info in devices:
        found = info.probe
        assert found is not None
        works = "no" if found.fault else f"yes, as {found.target}" if found.target else "yes"
        speeds = ["", ""] if found.fault else [f"{found.bandwidth:.0f}", f"{found.gflops:.0f}"]
        units, memory = str(info.compute_units), f"{info.memory / 2**30:.1f}"
        table.add_row(
            info.name, info.kind, info.platform, info.driver, works, units, memory, *speeds
        )
    return table
