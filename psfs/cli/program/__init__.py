"""A program with subcommands: its parser and its exit codes."""

from psfs.cli.program.parser import program_parser, run_command, run_program, version_line

__all__ = ["program_parser", "run_command", "run_program", "version_line"]
