"""`psfs devices`: the OpenCL devices of this machine."""

from __future__ import annotations

import argparse

from rich.table import Table

from cl import list_devices, select_device
from psfs.cli.commandline import stdout


def run(args: argparse.Namespace) -> None:
    devices = list_devices()
    if not devices:
        select_device()  # says what there could be
    table = Table("name", "kind", "platform", "driver")
    table.add_column("compute units", justify="right")
    table.add_column("memory GiB", justify="right")
    for info in devices:
        memory = f"{info.memory / 2**30:.1f}"
        units = str(info.compute_units)
        table.add_row(info.name, info.kind, info.platform, info.driver, units, memory)
    stdout.print(table)
