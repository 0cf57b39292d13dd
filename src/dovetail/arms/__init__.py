"""Arms: they follow a Target for a while, wherever the joints are."""
