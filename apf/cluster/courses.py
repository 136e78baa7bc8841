"""Workflows of several tasks in which later tasks need the results of earlier ones."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

from apf.cluster.pool import Pool, Task

#: A generator of workflow steps: it yields tasks that may run in parallel, receives their results
#: in that order, and returns the final result. If one of them fails, its exception is raised at the
#: `yield`.
Workflow = Generator[list[Task], list[Any], Any]


@dataclass
class _UnderWay:
    course: Workflow
    tasks: list[str] = field(default_factory=list)
    outcomes: dict[str, object] = field(default_factory=dict)


def run_workflows(
    pool: Pool, courses: Mapping[str, Workflow]
) -> Generator[tuple[str, Any], None, None]:
    """Run the workflows; yield the name of each with its result, or its exception, as they
    finish."""
    owners: dict[str, str] = {}
    begun: dict[str, _UnderWay] = {}

    def add(name: str, tasks: list[Task]) -> None:
        begun[name].tasks, begun[name].outcomes = [task.name for task in tasks], {}
        for task in tasks:
            owners[task.name] = name
            pool.add(task)

    for name, course in courses.items():
        begun[name] = _UnderWay(course)
        add(name, next(course))
    with closing(pool.outcomes()) as outcomes:
        for task, outcome in outcomes:
            name = owners[task.name]
            under_way = begun.get(name)
            if under_way is None:
                continue  # another task of this workflow has failed
            under_way.outcomes[task.name] = outcome
            try:
                if isinstance(outcome, BaseException):
                    add(name, under_way.course.throw(outcome))
                elif len(under_way.outcomes) == len(under_way.tasks):
                    found = [under_way.outcomes[one] for one in under_way.tasks]
                    add(name, under_way.course.send(found))
            except StopIteration as end:
                del begun[name]
                yield name, end.value
            except Exception as error:
                del begun[name]
                yield name, error
