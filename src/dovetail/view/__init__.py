"""Pictures and films of a workcell, made without a screen."""
