"""`psfs devices`: the OpenCL devices of this machine, and whether they work."""

from __future__ import annotations

from rich.table import Table

from cl import list_devices, select_device
from psfs.cli.commandline import stdout, warn
from psfs.request import DevicesRequest


def run(request: DevicesRequest) -> None:
    devices = list_devices(afresh=True)
    if not devices:
        select_device()  # raises an error that names what to install
    table = Table()
    table.add_column("name, platform", overflow="fold")
    for heading in ("kind", "driver", "works"):
        table.add_column(heading, no_wrap=True)
    for heading in ("units", "GiB"):
        table.add_column(heading, justify="right", no_wrap=True)
    for info in devices:  # the device of `auto` first
        found = info.probe
        assert found is not None
        works = "no" if found.fault else f"yes, as {found.target}" if found.target else "yes"
        units, memory = str(info.compute_units), f"{info.memory / 2**30:.1f}"
        name = f"{info.name}\n{info.platform}"
        table.add_row(name, info.kind, info.driver, works, units, memory)
    stdout.print(table)
    broken = [info for info in devices if info.probe and info.probe.fault]
    if len(broken) == len(devices):
        select_device()  # raises an error with the faults of all devices
    for info in broken:
        assert info.probe is not None
        warn(f"{info.name} does not work: {info.probe.fault}", stdout)
