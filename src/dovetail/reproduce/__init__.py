"""The paper's experiments in one command: plan, run, resume, report."""
