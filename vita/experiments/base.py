"""What an experiment is: independent jobs, and a report made of their results.

A job is a module-level function with plain arguments, so that it can run in this process, in one of
several worker processes, or on a Dask cluster, with the same result: its seed is an argument.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from vita.errors import UnknownName

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Job:
    """One independent piece of work."""

    label: str
    """A few words for the progress bar."""
    work: Callable[..., Any]
    """A function at the top level of a module; its result must be picklable and small."""
    arguments: Mapping[str, Any]


@dataclass(frozen=True)
class Table:
    """Rows of a CSV file, or of the markdown table."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[object]]
    """Numbers or text; None and NaN are shown as a dash."""
    notes: str = ""
    """What a reader must know to judge the figures."""


@dataclass(frozen=True)
class Check:
    """A figure that is to be reached. One that is missed makes the command's exit code 1."""

    what: str
    """What is measured, with its unit."""
    ours: float
    least: float = -math.inf
    most: float = math.inf
    """The figure must lie between `least` and `most`."""

    @property
    def met(self) -> bool:
        return self.least <= self.ours <= self.most

    @property
    def wanted(self) -> str:
        """The bounds in words."""
        if self.least == self.most:
            return f"{self.least:g}"
        low = f"at least {self.least:g}" if math.isfinite(self.least) else ""
        high = f"at most {self.most:g}" if math.isfinite(self.most) else ""
        return " and ".join(filter(None, (low, high))) or "any"


@dataclass(frozen=True)
class Report:
    """What an experiment found."""

    summary: str
    """A few sentences: the main figures, the document's beside ours, and what was not reproduced."""
    tables: Sequence[Table]
    """For the markdown report, the document's figure beside ours."""
    data: Mapping[str, Table] = field(default_factory=dict)
    """File name (without .csv) to all figures, one row for each setting."""
    figures: Mapping[str, Figure] = field(default_factory=dict)
    """File name (without .png) to plot."""
    checks: Sequence[Check] = ()
    """The figures to reach."""


class Experiment(ABC):
    """One experiment of the documents."""

    name: ClassVar[str]
    """As given on the command line."""
    title: ClassVar[str]
    doc: ClassVar[str]
    """One sentence: the question that it answers, with the document's table or figure."""

    @abstractmethod
    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        """The work. `quick` is a thinner sweep of the same thing, under 30 s altogether on 2 cores."""

    @abstractmethod
    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        """The report; `results` are in the order of `jobs`."""


EXPERIMENTS: dict[str, Experiment] = {}
"""Name to experiment; `vita.experiments.all` fills it."""


def register(experiment: type[Experiment]) -> type[Experiment]:
    """Add an experiment. Raises `ValueError` on a name that is taken."""
    if experiment.name in EXPERIMENTS:
        raise ValueError(f"experiment {experiment.name!r} is registered twice")
    EXPERIMENTS[experiment.name] = experiment()
    return experiment


def experiment_of(name: str) -> Experiment:
    """Raises `UnknownName` with the choices."""
    try:
        return EXPERIMENTS[name]
    except KeyError:
        raise UnknownName("experiment", name, EXPERIMENTS) from None
