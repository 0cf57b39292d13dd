"""Learning: train a policy in simulation, keep it as plain numbers, run it anywhere."""
