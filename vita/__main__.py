"""`python -m vita` is the same as `vita`."""

from vita.cli import entry

entry()
