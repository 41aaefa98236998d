"""One task file that uses every table, for tests that spoil it in one place."""

TASK = """\
schema = 1
title = "Touch the card's corner with the tool tip, two views"
seed = 7
[scene]
robot = "wam7"
q0_deg = [0, -35, 0, 110, 0, 15, 0]
tool = "card_tool"
objects = [{ name = "card", kind = "card", xyz = [0.55, 0.10, 0.02], rpy_deg = [0, 0, 20] }]
[[camera]]
name = "left"
look_from = [1.2, -0.9, 0.7]
look_at = [0.45, 0.0, 0.25]
fov_deg = 50
size = [640, 480]
[[camera]]
name = "hand"
mount = "tool"
xyz = [0.0, 0.05, 0.0]
[[tracker]]
name = "tip_l"
camera = "left"
kind = "auto"
at = [312.0, 208.5]
[[tracker]]
name = "corner_l"
camera = "left"
kind = "projected"
attach = { body = "card", point = [0, 0, 0.12] }
noise = { kind = "gaussian", sigma_px = 0.2 }
[[tracker]]
name = "goal_h"
camera = "hand"
kind = "fixed"
at = [320, 240]
[[constraint]]
name = "tip_on_corner_l"
kind = "point_to_point"
points = ["tip_l", "corner_l"]
weight = 1.0
[servo]
gain = 1
explore_deg = 4.0
joints = [0, 1, 2, 3]
[limits]
speed_rad_s = 0.6
joint = [{ joint = 0, lower_deg = -90 }]
[[script]]
at_s = 0.0
do = "start"
[[script]]
at_s = 1
do = "set"
field = "gain"
value = 0.25
[[script]]
at_s = 3.0
do = "move_camera"
camera = "left"
look_from = [1, 2, 3]
look_at = [0, 0, 0]
[[script]]
at_s = 4.0
do = "push_robot"
dq_deg = [1, 2]
[expect]
outcome = "converged"
within_s = 20.0
final_error_px = 1.0
final_distance_mm = { of = "tool", point = [0, 0, 0.12], to = "card", at = [0.03, 0.04, 0.0], max = 2.0 }
"""
