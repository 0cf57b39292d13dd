"""What an arm is found to be when its own small torques push it."""
