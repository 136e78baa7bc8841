"""The flags of a take, checked before anything is opened."""

from __future__ import annotations

import argparse

from apf.cli.first_pose import check_start
from apf.cli.method_flags import select_method
from apf.cli.takes.job import list_seeds
from apf.cli.takes.people import read_people_flag
from apf.filters.method import Method


def check_flags(args: argparse.Namespace) -> Method:
    """Return the method that the flags of a take ask for. Raises InputError for impossible values,
    and for flags that exclude each other."""
    method = select_method(args)
    list_seeds(args, method)
    read_people_flag(args, method)
    check_start(args)
    return method
