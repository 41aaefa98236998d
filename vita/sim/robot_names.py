"""The names of the robots that ship; a file of its own so that the command line need not load a simulator."""

ROBOTS: tuple[str, ...] = ("wam4", "wam7", "tx90", "puma560")
