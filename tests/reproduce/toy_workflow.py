"""Stages that take a moment: commands of the shell, by a Snakefile of their own."""

import json

from dovetail.reproduce.folder import SETTINGS
from dovetail.reproduce.plan import Stage

SNAKEFILE = """
configfile: "reproduce.json"

rule all:
    input: expand("stages/{stage}/done", stage=config["stages"])

rule toy:
    input: lambda w: [f"stages/{n}/done" for n in config["stages"][w.stage]["needs"]]
    output: touch("stages/{stage}/done")
    log: "stages/{stage}/log.txt"
    params: command=lambda w: config["stages"][w.stage]["options"][0]
    shell: "exec >> {log} 2>&1; cd stages/{wildcards.stage}; {params.command}"
"""


def toy(name, command="echo x >> ran", needs=()):
    return Stage(name=name, rule="toy", needs=tuple(needs), words=(command,))


def write(root, stages):
    """Leaves what `dovetail reproduce` leaves for its Snakefile."""
    plan = {"stages": {stage.name: stage.to_json() for stage in stages}}
    (root / SETTINGS).write_text(json.dumps(plan))
    return stages
