"""What a Barrett WAM looks like: our own solids per body and colour, in the frames of the URDF links.

Round white base, ball-like shoulder between two cheeks, slim upper arm with black rings, offset
elbow, slim forearm, compact wrist. Each body function returns (colour, solid) pairs.
"""

from __future__ import annotations

import numpy as np

from vita.sim.arm_spec import Drawing, Part
from vita.sim.lying import along_y, upright
from vita.sim.shapes import (
    Solid,
    ball,
    band,
    capsule,
    drum,
    fillet,
    hoop,
    joined,
    lathe,
    rounded_rectangle,
    slab,
    stadium,
)

COLORS: dict[str, tuple[float, float, float]] = {
    "white": (0.88, 0.89, 0.90),
    "grey": (0.58, 0.60, 0.62),
    "black": (0.09, 0.09, 0.10),
    "metal": (0.74, 0.76, 0.78),
}


def base() -> list[Part]:
    foot = slab(rounded_rectangle(0.30, 0.28, 0.05), -0.346, -0.322, 0.004)
    column = lathe(
        fillet([(0.001, -0.33), (0.128, -0.33), (0.122, -0.27), (0.108, -0.185), (0.001, -0.185)], 0.02)
    )
    collar = drum(0.112, -0.19, -0.160, 0.004)
    cabinet = slab(rounded_rectangle(0.13, 0.20, 0.022), -0.324, -0.21, 0.006).shifted(x=-0.125)
    panel = slab(rounded_rectangle(0.012, 0.15, 0.005), -0.31, -0.225, 0.002).shifted(x=-0.19)
    plugs = [_plug(drum(0.011, 0.19, 0.207, 0.002), y, -0.265) for y in (-0.045, 0.0, 0.045)]
    bolts = [
        drum(0.012, -0.323, -0.315, 0.002).shifted(x, y) for x in (-0.118, 0.118) for y in (-0.108, 0.108)
    ]
    return [
        ("grey", foot), ("white", column), ("black", collar), ("white", cabinet), ("black", panel),
        ("metal", joined(plugs)), ("metal", joined(bolts)),
    ]  # fmt: skip


def _plug(solid: Solid, y: float, z: float) -> Solid:
    """Lay a solid that stands along z down along -x."""
    return solid.moved(np.array([[0, 0, -1, 0], [0, 1, 0, y], [1, 0, 0, z], [0, 0, 0, 1.0]]))


def link1() -> list[Part]:
    """The turret with the two cheeks that hold the shoulder."""
    outside = [(0.001, -0.158), (0.112, -0.158), (0.150, -0.105), (0.150, -0.088)]
    turret = lathe(fillet([*outside, (0.112, -0.100), (0.001, -0.125)], 0.015))
    ring = hoop(0.135, 0.1525, -0.106, -0.092)
    parts: list[Part] = [("white", turret), ("black", ring)]
    for side in (-1, 1):
        # A cheek is a round-ended plate standing on the turret, around the axis of joint 2.
        plate = slab(stadium((0.0, 0.0), (0.0, -0.10), 0.088, 0.098), 0.112, 0.160, 0.010)
        parts.append(("white", _cheek(plate, side)))
        dome = [(0.001, 0.150), (0.079, 0.150), (0.079, 0.166), (0.060, 0.184), (0.001, 0.190)]
        parts.append(("black", _cheek(band(0.0815, 0.152, 0.165), side)))
        parts.append(("white", _cheek(lathe(fillet(dome, 0.012)), side)))
        parts.append(("metal", _cheek(drum(0.016, 0.180, 0.1915, 0.002), side)))
    return parts


def _cheek(solid: Solid, side: int) -> Solid:
    """From a plate's frame (x forward, y up, z outwards) to one side of the shoulder."""
    T = np.array([[-side, 0, 0, 0], [0, 0, side, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    return solid.moved(T)


def link2() -> list[Part]:
    """The ball of the shoulder with the neck that carries the upper arm."""
    body = ball(0.106, 28, 12)
    profile = [(0.001, 0.02), (0.100, 0.02), (0.092, 0.085), (0.074, 0.135), (0.074, 0.160), (0.001, 0.160)]
    neck = lathe(fillet(profile, 0.015))
    hubs = [_cheek(drum(0.084, 0.070, 0.113, 0.004), side) for side in (-1, 1)]
    ring = band(0.0765, 0.140, 0.154)
    standing = [("white", body), ("white", neck), ("black", joined(hubs)), ("black", ring)]
    return [(color, upright(solid)) for color, solid in standing]


def link3() -> list[Part]:
    """The slim upper arm and the outer half of the offset elbow."""
    tube = [(0.050, 0.262), (0.0415, 0.33), (0.0405, 0.475), (0.001, 0.475)]
    shell = lathe(fillet([(0.001, 0.162), (0.074, 0.162), (0.074, 0.190), *tube], 0.02))
    rings = [band(0.0755, 0.166, 0.172), band(0.0425, 0.458, 0.474)]
    bridge = capsule((0.0, 0.0, 0.47), (0.018, 0.0, 0.505), 0.039, 0.036)
    # Two plates reach from the tube to the elbow axis, 45 mm in front of it.
    plate = slab(stadium((0.0, 0.47), (0.045, 0.55), 0.034, 0.041), 0.029, 0.047, 0.005)
    caps = drum(0.031, 0.044, 0.0525, 0.003)
    hubs = drum(0.009, 0.050, 0.0545, 0.002)
    cover = slab(rounded_rectangle(0.018, 0.040, 0.007), 0.28, 0.455, 0.004).shifted(x=-0.037)
    parts: list[Part] = [("white", shell), ("black", joined(rings)), ("white", bridge), ("black", cover)]
    for side in (-1, 1):
        parts += [("white", _plate(plate, side)), ("black", _plate(caps, side, True))]
        parts += [("metal", _plate(hubs, side, True))]
    return parts


def _plate(solid: Solid, side: int, at_elbow: bool = False) -> Solid:
    """From a plate's frame (x forward, y along the arm, z outwards) to one side of the upper arm."""
    if at_elbow:
        solid = solid.shifted(x=0.045, y=0.55)
    T = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    if side > 0:
        mirrored = Solid(solid.vertices * np.array([1, 1, -1]), solid.faces[:, ::-1].copy())
        return mirrored.moved(T)
    return solid.moved(T)


def _elbow() -> list[Part]:
    """The inner half of the elbow: a drum on the joint axis and an arm back to the centre line."""
    hub = along_y(drum(0.039, -0.0275, 0.0275, 0.004)).shifted(x=0.045)
    strap = along_y(band(0.0402, -0.012, 0.012)).shifted(x=0.045)
    bridge = capsule((0.036, 0.0, 0.010), (0.0, 0.0, 0.052), 0.027, 0.036)
    return [("white", hub), ("black", strap), ("white", bridge)]


def forearm() -> list[Part]:
    """WAM 7: elbow to the start of the wrist."""
    profile = [(0.001, 0.045), (0.037, 0.045), (0.037, 0.14), (0.043, 0.19), (0.043, 0.214), (0.001, 0.214)]
    tube = lathe(fillet(profile, 0.012))
    ring = band(0.0445, 0.202, 0.212)
    cuff = band(0.0382, 0.064, 0.074)
    cover = slab(rounded_rectangle(0.016, 0.034, 0.006), 0.085, 0.185, 0.004).shifted(x=-0.034)
    parts = [*_elbow(), ("white", tube), ("black", ring), ("black", cuff), ("black", cover)]
    return [(color, upright(solid, -0.045)) for color, solid in parts]


def outer() -> list[Part]:
    """WAM 4: elbow to the tool plate at 0.35 m."""
    profile = [(0.001, 0.045), (0.037, 0.045), (0.034, 0.30), (0.040, 0.325), (0.040, 0.340), (0.001, 0.340)]
    tube = lathe(fillet(profile, 0.012))
    cuff = band(0.0382, 0.064, 0.074)
    ring = band(0.0412, 0.322, 0.332)
    plate = drum(0.036, 0.339, 0.35, 0.0015)
    cover = slab(rounded_rectangle(0.016, 0.034, 0.006), 0.09, 0.25, 0.004).shifted(x=-0.031)
    parts = [*_elbow(), ("white", tube), ("black", cuff), ("black", ring), ("metal", plate), ("black", cover)]
    return [(color, upright(solid, -0.045)) for color, solid in parts]


def wrist1() -> list[Part]:
    """The turning fork of the wrist; its frame is at the elbow, z along the forearm."""
    profile = [(0.001, 0.215), (0.043, 0.215), (0.043, 0.240), (0.034, 0.262), (0.001, 0.262)]
    body = lathe(fillet(profile, 0.008))
    prong = slab(stadium((0.0, 0.250), (0.0, 0.30), 0.033, 0.033), 0.030, 0.044, 0.004)
    cap = drum(0.024, 0.042, 0.049, 0.002).shifted(y=0.30)
    hub = drum(0.008, 0.046, 0.051, 0.0015).shifted(y=0.30)
    parts: list[Part] = [("white", body)]
    for side in (-1, 1):
        parts += [("white", _plate(prong, side)), ("black", _plate(cap, side)), ("metal", _plate(hub, side))]
    return parts


def wrist2() -> list[Part]:
    """The drum between the prongs and the stub that carries the flange."""
    hub = along_y(drum(0.031, -0.0285, 0.0285, 0.003))
    strap = along_y(band(0.0322, -0.014, 0.014))
    stub = drum(0.027, 0.0, 0.040, 0.003)
    parts = [("white", hub), ("black", strap), ("white", stub)]
    return [(color, upright(solid)) for color, solid in parts]


def flange() -> list[Part]:
    profile = [(0.001, 0.041), (0.030, 0.041), (0.042, 0.050), (0.042, 0.0609), (0.001, 0.0609)]
    plate = lathe(fillet(profile, 0.0015))
    ring = band(0.0428, 0.0525, 0.0570)
    return [("metal", plate), ("black", ring)]


BODIES: dict[str, Drawing] = {
    body.__name__: body for body in (base, link1, link2, link3, forearm, outer, wrist1, wrist2, flange)
}
