"""Arms of seven joints: what a robot is, and one file for each that is known."""
