"""Hostile input by the thousand, as commands: `vita fuzz` and `vita soak`."""
