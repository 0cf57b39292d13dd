"""Parts of the attacks that `adversary.py` and `evolved_attack.py` run."""
