"""The figures of thesis tables 5.1 to 5.3, as printed, to show beside ours."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Printed:
    """One row of a table: the thesis' result over 360 placements."""

    image_px: float
    """Mean final image error, summed over all coordinates [px]."""
    distance_m: float
    """Mean final 3D error, summed over the three points [m]."""
    steps: float
    """The column 'mean steps to <10 px'; see `camera_rotation` for what it really counts."""
    diverged: int
    """Of 360."""


PLACEMENTS = 360
DELTAS_DEG = (2, 4, 6, 8, 10)
GAINS = (0.25, 0.5, 0.75, 1.0)

_TABLES: dict[str, tuple[str, str]] = {
    "integer": (
        "Table 5.1",
        """
         2 0.25  8.151261 0.007660  8.900662  3
         2 0.50  2.484507 0.004600  4.525526  5
         2 0.75  2.544413 0.003703  2.966767 11
         2 1.00  5.115854 0.005070  2.653979 32
         4 0.25  5.445682 0.005613  8.813953  1
         4 0.50  1.242340 0.003169  4.640805  1
         4 0.75  1.500000 0.003176  3.184971  4
         4 1.00  2.800000 0.003586  2.752613 45
         6 0.25  5.433333 0.005976  8.834983  0
         6 0.50  0.938889 0.002876  4.658046  0
         6 0.75  0.902778 0.002811  3.207977  0
         6 1.00  3.875776 0.004209  2.843636 38
         8 0.25  6.216667 0.005973  8.840532  0
         8 0.50  1.047222 0.002960  4.662824  0
         8 0.75  0.986111 0.003000  3.323864  0
         8 1.00  3.531250 0.004253  2.925000 40
        10 0.25  5.952778 0.006031  8.817881  0
        10 0.50  0.941667 0.002883  4.691429  0
        10 0.75  0.994444 0.002940  3.292264  0
        10 1.00  3.088608 0.003802  2.945055 44
        """,
    ),
    "perfect": (
        "Table 5.2",
        """
         2 0.25  5.264595 0.003251  8.855263  0
         2 0.50  0.546380 0.000382  4.738889  0
         2 0.75  0.171979 0.000165  3.211111  0
         2 1.00  1.042769 0.000614  3.161290 43
         4 0.25  5.456003 0.003420  8.844884  0
         4 0.50  0.594838 0.000420  4.752778  0
         4 0.75  0.198895 0.000187  3.255556  0
         4 1.00  0.585607 0.000438  3.098361 52
         6 0.25  5.644139 0.003586  8.831683  0
         6 0.50  0.643409 0.000460  4.766667  0
         6 0.75  0.228489 0.000212  3.302778  0
         6 1.00  0.818172 0.000629  3.102310 53
         8 0.25  5.831923 0.003751  8.808581  0
         8 0.50  0.691667 0.000504  4.777778  0
         8 0.75  0.261425 0.000241  3.330556  0
         8 1.00  0.625176 0.000468  3.099338 57
        10 0.25  6.021153 0.003916  8.798680  0
        10 0.50  0.739442 0.000552  4.772222  0
        10 0.75  0.298541 0.000273  3.358333  0
        10 1.00  0.913177 0.000645  3.145695 55
        """,
    ),
    "gaussian": (
        "Table 5.3",
        """
         2 0.25  8.868672 0.006711  8.769231  1
         2 0.50  6.266691 0.004368  4.485207  3
         2 0.75  6.071691 0.004064  2.996970 12
         2 1.00  6.527398 0.003631  2.540268 31
         4 0.25  7.145731 0.005205  8.776667  0
         4 0.50  3.809346 0.002252  4.661017  1
         4 0.75  4.435710 0.002510  3.135057  2
         4 1.00  5.905690 0.003537  2.915033 26
         6 0.25  8.374407 0.005089  8.827815  0
         6 0.50  4.006011 0.002318  4.662857  0
         6 0.75  4.521807 0.002685  3.197708  1
         6 1.00  6.235470 0.003426  2.919861 39
         8 0.25  7.860871 0.004988  8.794020  0
         8 0.50  3.998573 0.002287  4.667614  0
         8 0.75  4.410463 0.002336  3.289773  0
         8 1.00  5.754420 0.003414  3.035211 44
        10 0.25  8.266994 0.005281  8.771523  0
        10 0.50  4.132635 0.002533  4.648415  0
        10 0.75  4.324643 0.002491  3.284507  0
        10 1.00  6.246298 0.003606  2.985455 44
        """,
    ),
}
"""Tracker to the table's name and its rows: Delta [deg], lambda, and the four columns of `Printed`."""

TRACKERS = tuple(_TABLES)


def name_of(tracker: str) -> str:
    """Which table of the thesis is about this tracker."""
    return _TABLES[tracker][0]


def _read(text: str) -> dict[tuple[int, float], Printed]:
    rows = [line.split() for line in text.strip().splitlines()]
    return {
        (int(delta), float(gain)): Printed(float(image), float(distance), float(steps), int(diverged))
        for delta, gain, image, distance, steps, diverged in rows
    }


PRINTED = {
    (tracker, *setting): row for tracker, (_, text) in _TABLES.items() for setting, row in _read(text).items()
}
"""(tracker, Delta [deg], lambda) to the row; 60 of them."""
