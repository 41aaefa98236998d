"""What our arm in the manner of a Puma 560 looks like: our own solids per body and colour.

A slender grey-white trunk, a barrel of a shoulder that sticks out to the right, a flat tapering upper arm
at the barrel's end, a forearm between it and the trunk, a small wrist. Drawn in the frames of the URDF
links (see `ArmSpec`): at zero the upper arm points along x of link 2, the forearm along y of link 3 and
along z of link 4; z of links 2 and 3 points to the right.
"""

from __future__ import annotations

from vita.sim.arm_spec import Drawing, Part
from vita.sim.casing import casing
from vita.sim.lying import along_x, along_y, mirrored_z, upright
from vita.sim.shapes import band, drum, fillet, joined, lathe, rounded_rectangle, slab, stadium

COLORS: dict[str, tuple[float, float, float]] = {
    "white": (0.86, 0.86, 0.83),
    "grey": (0.60, 0.61, 0.60),
    "dark": (0.17, 0.18, 0.19),
    "metal": (0.72, 0.74, 0.76),
}
FLOOR = -0.6718
"""The mounting plane below the shoulder [m]."""
UPPER = FOREARM = 0.4318
"""Lengths of upper arm and forearm [m]."""
ELBOW = (0.0203, 0.15005)
"""From the elbow's axis to the forearm's, and the forearm's place along the elbow's axis [m]."""
SIDE = 0.199
"""Where the shoulder ends and the upper arm begins, to the right of the trunk's axis [m]."""


def base() -> list[Part]:
    foot = slab(rounded_rectangle(0.33, 0.33, 0.06), FLOOR, FLOOR + 0.024, 0.006)
    profile = [(0.001, FLOOR + 0.02), (0.125, FLOOR + 0.02), (0.094, FLOOR + 0.07)]
    trunk = lathe(fillet([*profile, (0.088, -0.20), (0.088, -0.142), (0.001, -0.142)], 0.02))
    plugs = [
        along_x(drum(0.013, -0.126, -0.118, 0.002)).shifted(y=y, z=FLOOR + 0.12) for y in (-0.03, 0.0, 0.03)
    ]
    cabinet = slab(rounded_rectangle(0.09, 0.13, 0.02), FLOOR + 0.02, FLOOR + 0.19, 0.010).shifted(x=-0.075)
    bolts = [
        drum(0.011, FLOOR + 0.02, FLOOR + 0.031, 0.002).shifted(x, y)
        for x in (-0.13, 0.13) for y in (-0.13, 0.13)
    ]  # fmt: skip
    ring = drum(0.083, -0.15, -0.128, 0.002)
    return [
        ("grey", foot), ("white", trunk), ("grey", cabinet), ("dark", ring),
        ("metal", joined(plugs)), ("metal", joined(bolts)),
    ]  # fmt: skip


def link1() -> list[Part]:
    """The trunk's turning head with the barrel of the shoulder across it."""
    neck = lathe(
        fillet([(0.001, -0.128), (0.088, -0.128), (0.088, -0.095), (0.098, -0.02), (0.001, 0)], 0.02)
    )
    barrel = along_y(drum(0.104, -0.188, 0.112, 0.016))
    lid = along_y(drum(0.082, 0.08, 0.122, 0.006))
    hub = along_y(drum(0.020, 0.1, 0.127, 0.003))
    strap = along_y(band(0.1052, -0.120, -0.108))
    ring = along_y(drum(0.090, -SIDE, -0.17, 0.002))
    parts: list[Part] = [("white", neck), ("white", barrel), ("grey", lid), ("metal", hub)]
    return [*parts, ("grey", strap), ("dark", ring)]


def link2() -> list[Part]:
    """The upper arm, which reaches back behind the shoulder as well."""
    shell = casing((-0.075, 0.0), (UPPER, 0.0), 0.112, 0.072, SIDE, 0.287, 0.016)
    cover = slab(stadium((-0.085, 0.0), (UPPER - 0.14, 0.0), 0.080, 0.064), 0.27, 0.292, 0.003)
    disc = drum(0.050, 0.27, 0.294, 0.004).shifted(x=UPPER)
    hub = drum(0.016, 0.28, 0.298, 0.003).shifted(x=UPPER)
    return [("white", shell), ("grey", cover), ("grey", disc), ("metal", hub)]


def link3() -> list[Part]:
    """The forearm with its bulge behind the elbow, and the collar in which the wrist turns."""
    x, z = ELBOW
    shell = casing((0.0, -0.045), (x, 0.335), 0.082, 0.046, z - 0.042, z + 0.040, 0.016)
    ring = drum(0.060, z + 0.03, SIDE + 0.01, 0.002)
    cover = slab(stadium((0.0, -0.035), (x, 0.24), 0.056, 0.040), z - 0.047, z - 0.03, 0.003)
    collar = along_y(drum(0.036, 0.35, 0.388, 0.004)).shifted(x=x, z=z)
    turn = along_y(drum(0.032, 0.38, 0.394, 0.001)).shifted(x=x, z=z)
    parts: list[Part] = [("white", shell), ("dark", ring), ("grey", cover), ("white", collar)]
    return [*parts, ("dark", turn)]


def link4() -> list[Part]:
    """The fork of the wrist."""
    crown = drum(0.038, 0.394, 0.406, 0.003)
    prong = casing((0.0, 0.405), (0.0, FOREARM), 0.030, 0.028, 0.027, 0.038, 0.004)
    cap = drum(0.020, 0.035, 0.041, 0.002).shifted(y=FOREARM)
    parts: list[Part] = [("white", crown)]
    for color, solid in (("white", prong), ("dark", cap)):
        for one in (solid, mirrored_z(solid)):
            # From (across, along, outwards) to the link's x, z and -y.
            parts.append((color, upright(one)))
    return parts


def link5() -> list[Part]:
    """The drum between the prongs and the stub that carries the flange."""
    hub = drum(0.026, -0.0258, 0.0258, 0.003)
    strap = band(0.0266, -0.006, 0.006)
    stub = along_y(drum(0.022, 0.0, 0.036, 0.002))
    return [("white", hub), ("dark", strap), ("white", stub)]


def link6() -> list[Part]:
    plate = lathe(
        fillet([(0.001, 0.036), (0.024, 0.036), (0.031, 0.043), (0.031, 0.05625), (0.001, 0.05625)], 0.0015)
    )
    return [("metal", plate), ("dark", band(0.0315, 0.0455, 0.0495))]


BODIES: dict[str, Drawing] = {
    body.__name__: body for body in (base, link1, link2, link3, link4, link5, link6)
}
