"""What our industrial arm in the manner of a Staubli TX90 looks like: our own solids per body and colour.

Round yellow casings with dark joints: a pedestal, a turret that carries the shoulder, an upper arm at the
side of the shoulder, a forearm back in the middle, a wrist between two cheeks. Drawn in the frames of
the URDF links (see `ArmSpec`): at zero the upper arm points along x of link 2, the forearm along -y of
link 3 and along z of link 4.
"""

from __future__ import annotations

from vita.sim.arm_spec import Drawing, Part
from vita.sim.casing import casing
from vita.sim.lying import along_x, along_y, mirrored_z, upright
from vita.sim.shapes import band, capsule, drum, fillet, joined, lathe, rounded_rectangle, slab

COLORS: dict[str, tuple[float, float, float]] = {
    "yellow": (0.93, 0.70, 0.10),
    "dark": (0.16, 0.17, 0.19),
    "metal": (0.70, 0.72, 0.75),
}
SHOULDER = (0.05, 0.478)
"""Forward and up from the base to the axis of joint 2 [m]."""
SIDE = 0.108
"""Where the shoulder ends and the upper arm begins, to the left of the middle [m]."""
MIDDLE = 0.05
"""The forearm's middle, to the left of the shoulder's [m]."""
UPPER = FOREARM = 0.425
"""Lengths of upper arm and forearm [m]."""


def base() -> list[Part]:
    foot = drum(0.172, 0.0, 0.022, 0.005)
    profile = [(0.001, 0.02), (0.150, 0.02), (0.140, 0.07), (0.122, 0.15), (0.122, 0.200), (0.001, 0.200)]
    column = lathe(fillet(profile, 0.03))
    cabinet = slab(rounded_rectangle(0.13, 0.17, 0.025), 0.02, 0.15, 0.012).shifted(x=-0.115)
    plugs = [along_x(drum(0.014, -0.190, -0.178, 0.002)).shifted(y=y, z=0.085) for y in (-0.045, 0.0, 0.045)]
    bolts = [drum(0.011, 0.02, 0.029, 0.002).shifted(x, y) for x in (-0.11, 0.11) for y in (-0.115, 0.115)]
    ring = drum(0.117, 0.195, 0.212, 0.002)
    return [
        ("dark", foot), ("yellow", column), ("yellow", cabinet), ("dark", ring),
        ("metal", joined(plugs)), ("metal", joined(bolts)),
    ]  # fmt: skip


def link1() -> list[Part]:
    """The turret and the shoulder's barrel, which lies across it."""
    x, z = SHOULDER
    skirt = drum(0.127, 0.212, 0.33, 0.016)
    torso = capsule((0.0, 0.0, 0.335), (x, 0.0, z), 0.1275, 0.122)
    barrel = along_y(drum(0.122, -0.120, 0.098, 0.022)).shifted(x=x, z=z)
    lid = along_y(drum(0.092, -0.134, -0.10, 0.010)).shifted(x=x, z=z)
    hub = along_y(drum(0.020, -0.139, -0.12, 0.003)).shifted(x=x, z=z)
    ring = along_y(drum(0.108, 0.08, SIDE, 0.002)).shifted(x=x, z=z)
    parts: list[Part] = [("yellow", skirt), ("yellow", torso), ("yellow", barrel), ("yellow", lid)]
    return [*parts, ("metal", hub), ("dark", ring)]


def link2() -> list[Part]:
    """The upper arm: a round-ended casing at the left side, from the shoulder to the elbow."""
    shell = casing((0.0, 0.0), (UPPER, 0.0), 0.118, 0.098, SIDE, 0.224, 0.040)
    covers = [drum(0.082, 0.19, 0.232, 0.008), drum(0.066, 0.19, 0.230, 0.008).shifted(x=UPPER)]
    hubs = [drum(0.018, 0.22, 0.237, 0.003), drum(0.015, 0.22, 0.235, 0.003).shifted(x=UPPER)]
    ring = drum(0.080, SIDE - 0.012, SIDE + 0.02, 0.002).shifted(x=UPPER)
    return [("yellow", shell), ("yellow", joined(covers)), ("metal", joined(hubs)), ("dark", ring)]


def link3() -> list[Part]:
    """The elbow's barrel and the root of the forearm."""
    barrel = drum(0.094, -0.086, SIDE - 0.012 - MIDDLE, 0.020)
    lid = drum(0.068, -0.098, -0.06, 0.008)
    hub = drum(0.015, -0.102, -0.08, 0.002)
    profile = [(0.001, 0.03), (0.086, 0.03), (0.082, 0.12), (0.074, 0.158), (0.001, 0.158)]
    root = upright(lathe(fillet(profile, 0.02)))
    ring = upright(drum(0.069, 0.15, 0.166, 0.002))
    return [("yellow", barrel), ("yellow", lid), ("metal", hub), ("yellow", root), ("dark", ring)]


def link4() -> list[Part]:
    """The forearm's turning tube with the two cheeks of the wrist."""
    profile = [(0.001, 0.166), (0.073, 0.166), (0.071, 0.24), (0.060, 0.33), (0.058, 0.372), (0.001, 0.372)]
    tube = lathe(fillet(profile, 0.02))
    # A cheek is a round-ended plate beside the axis of joint 5, which is y here; its own z points outwards.
    plate = casing((0.0, 0.345), (0.0, FOREARM), 0.050, 0.046, 0.036, 0.060, 0.010)
    cap = drum(0.033, 0.05, 0.064, 0.003).shifted(y=FOREARM)
    parts: list[Part] = [("yellow", tube)]
    for color, solid in (("yellow", plate), ("dark", cap)):
        for one in (solid, mirrored_z(solid)):
            # From (across, along, outwards) to the link's x, z and -y.
            parts.append((color, upright(one)))
    return parts


def link5() -> list[Part]:
    """The drum between the cheeks and the neck that carries the flange."""
    hub = drum(0.044, -0.0345, 0.0345, 0.006)
    neck = upright(lathe(fillet([(0.001, 0.01), (0.036, 0.01), (0.034, 0.066), (0.001, 0.066)], 0.006)))
    strap = band(0.0448, -0.010, 0.010)
    ring = upright(drum(0.030, 0.06, 0.073, 0.001))
    return [("yellow", hub), ("yellow", neck), ("dark", strap), ("dark", ring)]


def link6() -> list[Part]:
    profile = [(0.001, 0.073), (0.034, 0.073), (0.037, 0.082), (0.037, 0.1), (0.001, 0.1)]
    return [("metal", lathe(fillet(profile, 0.002))), ("dark", band(0.0376, 0.086, 0.091))]


BODIES: dict[str, Drawing] = {
    body.__name__: body for body in (base, link1, link2, link3, link4, link5, link6)
}
