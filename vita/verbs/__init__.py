"""The verbs of the command line, one small file each. What a verb needs is imported when it runs."""
