"""Work of several tasks, of which later ones need what earlier ones gave."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

from apf.cluster.pool import Pool, Task

#: Yields tasks that may be done at a time, gets their outcomes in that order, returns the result.
#: Where one of them fails its exception is raised at the `yield`.
Course = Generator[list[Task], list[Any], Any]


@dataclass
class _UnderWay:
    course: Course
    tasks: list[str] = field(default_factory=list)
    outcomes: dict[str, Any] = field(default_factory=dict)


def done_courses(
    pool: Pool, courses: Mapping[str, Course]
) -> Generator[tuple[str, Any], None, None]:
    """Yield the name of every course with what it returned, or the exception, as they are done."""
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
                continue  # one beside it has failed
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
