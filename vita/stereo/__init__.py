"""Two cameras whose geometry is known: points and poses from pixels, filtered, and tied to the robot."""
