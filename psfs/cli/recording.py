"""A parser that knows which flags it was given, through argparse's public interface."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any

#: Values that begin with a minus, as in `--up -z` and `--volume -1,1,...`: argparse takes them for
#: flags.
_NEGATIVE = re.compile(r"-([xyz]$|[\d.])")
#: Options that flags are parsed without, to find out which are stated.
_MEANING = ("type", "choices", "default", "required")


class RecordingParser(argparse.ArgumentParser):
    """A parser that records its flags and positionals.

    actions: all of them, in order. alternatives: the destinations of those that exclude each other.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        self.actions: list[argparse.Action] = []
        self.alternatives: list[set[str]] = []
        self._calls: list[tuple[tuple[str, ...], dict[str, Any]]] = []
        super().__init__(*args, **options)

    def add_argument(self, *names: str, **options: Any) -> argparse.Action:
        """Add a flag or a positional, and record it."""
        return self._keep(super().add_argument(*names, **options), names, options)

    def add_argument_group(self, *args: Any, **options: Any) -> Any:
        """Add a group whose flags are recorded, too."""
        return self._record_group(super().add_argument_group(*args, **options))

    def add_mutually_exclusive_group(self, **options: Any) -> Any:
        """Add a group of flags that exclude each other and are recorded."""
        return self._exclusive(super().add_mutually_exclusive_group(**options))

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse like argparse, but allow values that begin with a minus."""
        return super().parse_known_args(
            None if args is None else self._join_values(args), namespace
        )

    def find_stated(self, words: Sequence[str]) -> dict[str, Any]:
        """Return the values stated in `words`, by destination, as texts; flags without a value give
        their constants."""
        reader = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
        for names, options in self._calls:
            kept = {name: value for name, value in options.items() if name not in _MEANING}
            reader.add_argument(*names, **kept, default=argparse.SUPPRESS)
        return vars(reader.parse_known_args(self._join_values(words))[0])

    def _join_values(self, words: Sequence[str]) -> list[str]:
        """Return `words` with `--flag -value` as `--flag=-value`."""
        with_value = {
            name
            for action in self.actions
            if action.nargs is None
            for name in action.option_strings
            if name.startswith("--")
        }
        joined: list[str] = []
        for word in words:
            if joined and joined[-1] in with_value and _NEGATIVE.match(word):
                joined[-1] += f"={word}"
            else:
                joined.append(word)
        return joined

    def _keep(
        self, action: argparse.Action, names: tuple[str, ...], options: dict[str, object]
    ) -> argparse.Action:
        self.actions.append(action)
        self._calls.append((names, options))
        return action

    def _record_group(self, group: Any, own: set[str] | None = None) -> Any:
        """Return an argparse group that records its flags; `own` collects their destinations."""
        add, add_exclusive = group.add_argument, group.add_mutually_exclusive_group

        def add_argument(*names: str, **options: Any) -> argparse.Action:
            action = self._keep(add(*names, **options), names, options)
            if own is not None:
                own.add(action.dest)
            return action

        group.add_argument = add_argument
        group.add_mutually_exclusive_group = lambda **o: self._exclusive(add_exclusive(**o))
        return group

    def _exclusive(self, group: Any) -> Any:
        self.alternatives.append(set())
        return self._record_group(group, self.alternatives[-1])
