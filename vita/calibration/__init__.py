"""Intrinsics of a camera, or of two and how they stand to one another, from pictures of a printed board.

The stereo mode takes these as known (TUM II-B: "these parameters can be computed off-line").
"""
