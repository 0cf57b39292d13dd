"""Try a policy many times, and say honestly what came out."""
