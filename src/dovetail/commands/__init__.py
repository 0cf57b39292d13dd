"""The subcommands of `dovetail`: one file, one settings class with `run` each."""
