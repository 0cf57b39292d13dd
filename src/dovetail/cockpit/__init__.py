"""One page in the browser: see the arm, start and stop it, touch it, replay it."""
