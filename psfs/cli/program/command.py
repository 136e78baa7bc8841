"""A subcommand with lazy imports: its flags are imported when it is chosen, its work when it
runs."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module


@dataclass(frozen=True)
class Command:
    """A subcommand. help: one line. flags: the module whose `add_flags(parser)` adds the flags, and
    whose optional `check(args)` rejects arguments before the work is imported. work: the module
    whose `run(args)` runs it."""

    name: str
    help: str
    flags: str
    work: str

    def add_flags(self, parser: argparse.ArgumentParser) -> None:
        """Add the flags, importing their module."""
        import_module(self.flags).add_flags(parser)

    def run(self, args: argparse.Namespace) -> None:
        """Check the arguments, then import the work and run it. Raises UserError."""
        check: Callable[[argparse.Namespace], None] | None
        check = getattr(import_module(self.flags), "check", None)
        if check is not None:
            check(args)
        import_module(self.work).run(args)


def list_commands(package: str, **helps: str) -> tuple[Command, ...]:
    """Return the commands of the program in `package`, from their names and one-line helps; the
    flags of NAME are in `package.flags.NAME`, its work in `package.NAME`."""
    return tuple(
        Command(name, text, f"{package}.flags.{name}", f"{package}.{name}")
        for name, text in helps.items()
    )
