"""The documents' experiments as commands: one file each, on a vectorised simulation."""
