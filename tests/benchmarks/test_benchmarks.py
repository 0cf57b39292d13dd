"""Every benchmark runs, on a size so small that its figures mean nothing."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dovetail.errors import install_command
from extras import need_franka_sim_alone

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
EXAMPLES = BENCHMARKS.parent / "examples"
FRANKA_SIM = Path(__file__).parents[2] / ".venv/franka-sim/bin/python"
MODULES = {
    *("tracking_report", "cockpit_browser", "cockpit_client", "cockpit_garbage"),
    *("encoder_plant", "franka_in_step", "franka_shared", "franka_stops"),
    "franka_rehearsed",
}
"""Files that others import or start, and no one else."""
NEEDS = {
    "cockpit": {
        "viser": install_command("view"),
        "selenium": install_command("test"),
    },
    "cockpit_stop": {"viser": install_command("view")},
    "control_cycle": {
        "pinocchio": "pip install 'pin>=4.1'",
        "daqp": "pip install daqp",
    },
    "grpc_round_trip": {"grpc": install_command("rpc")},
    "camera": {"cv2": install_command("camera")},
    "identify_planted": {"cmaes": install_command("identify")},
    "identify_sampled": {"cmaes": install_command("identify")},
    "gps_and_sac": {"sbx": install_command("learn")},
    "identify_sysid": {
        "mujoco.sysid:optimize": "pip install 'mujoco[sysid]==3.17.0'",
    },
    "robosuite_osc": {
        "robosuite": "pip install robosuite==1.5.2 mujoco==3.3.0 in an environment of "
        "its own, and give its interpreter: benchmarks/tracking.py --robosuite PYTHON",
    },
    **{
        name: {"franka_sim": "make test-franka, which makes an environment of its own"}
        for name in (
            *("beside_franka_sim", "franka_peers"),
            *("rehearse_franka", "rehearse_franka --stops"),
        )
    },
    "demonstrations": {"sbx": install_command("learn", "view")},
    "specialists": {
        "sbx": install_command("learn"),
        "shapely": install_command("parts"),
    },
    "training_time": {"sbx": install_command("learn")},
    "learner_kills": {"grpc": install_command("rpc")},
    "adversary --contact": {"cmaes": install_command("identify")},
    "evolved_attack": {"cmaes": install_command("identify")},
}
"""What a benchmark needs beyond the package, and how to get it."""
TINY = {
    "adversary": ("--cycles 200 --period 0.005", "cycles"),
    "beside_franka_sim": (f"--python {FRANKA_SIM} echo beside it", "beside it"),
    "bad_samples": ("--spikes 2 --period 0.005 --plants mujoco", "Nm"),
    "batch": ("--turns 1 --steps 8 --cores 1 --envs 2", "one environment"),
    "camera": (
        "--pictures 6 --width 640 --calibrations 1 --plantings 2 --poses 8",
        "to pose",
    ),
    "aic_score": ("peg_square --tries 1 --tracker truth", "points of 300"),
    "blind_baselines": ("dovetail/PegInHole-v0 --most 2 --tries 1", "straight push"),
    "cabinet_rate": ("--plant mujoco --seconds 0.1", "periods/s"),
    "clip_pull": ("rail_clip --tries 1", "1 bear 20 N"),
    "cockpit": ("--seconds 1 --moves 2 --clicks 2 --garbage 200", "load"),
    "cockpit_stop": ("--tries 2 --twin easy", "2 of 2 tries"),
    "adversary --contact": ("--contact --cycles 20 --period 0.005 --quiet", "cycles"),
    "compare_tries": ("--repeats 2 --tries 20", "| 95 %, 85 % |"),
    "control_cycle": ("--period 0.005", "dovetail qp"),
    "env_step_rate": ("--steps 5", "steps/s"),
    "demonstrations": ("--count 1 --only-show", '"demonstrations": 1'),
    "evolved_attack": (
        "--cycles 400 --searches 1 --workers 1 --periods 0.005",
        "worst",
    ),
    "identify_contact": ("--twins 1 --shipped", "1 of 1 identified, 1 of 1 inside"),
    "loop_delay": ("--twins easy --periods 0.005 --delays 0.005", "worst error"),
    "cabinet_spring": (
        "--clock lockstep --periods 5 --stiffness 200 --damping 0.7 --repeats 1",
        "5 ms 200 Nm/rad 0.7: cabinet's spring",
    ),
    "fri_spikes": ("--spikes 4 --period 0.005 --kinds single", "spikes"),
    "fri_loop": ("--seconds 0.2", "x real time"),
    "fuzz_arm": ("--count 100", "100"),
    "fuzz_cabinet": ("--count 100", "100"),
    "grpc_round_trip": ("--steps 5 --waits 2", "RemoteArm.step"),
    "hops": ("", "calls in"),
    "identify_planted": ("--seeds 1 --workers 1 --cold --evaluations 2", "gravity"),
    "gps_and_sac": (
        "--out out --seeds 0 --steps 600 --every 300 --algorithms gps",
        "| fixed goals |",
    ),
    "identify_sampled": (
        "--twins 1 --sets paper --sequences 2 --evaluations 5 --out out",
        "paper: 1 twins",
    ),
    "identify_sysid": ("", "held-out error"),
    "learner_kills": ("--kills 1", "1 learners killed"),
    "losing_the_client": (
        "--tries 1 --clock lockstep --period 5ms --plant mujoco",
        "lockstep",
    ),
    "mesh_pairs": (". --out table", "pairs"),
    "specialists": (
        f"{EXAMPLES / 'hexagon.toml'} --out done --tries 1 --steps 600 --num-envs 4 "
        "--learning-starts 400 --eval-episodes 1",
        "1 of 1 pairs trained",
    ),
    "period_table": ("--tries 1 --twin none --period 5ms --push 0", "| none"),
    "policy_range": (
        "--tries 1 --policy peg_square --disturbance push",
        "| `peg_square` |",
    ),
    "rendering": ("--frames 5", "ratio"),
    "rehearse_franka": (
        f"--minutes 0.05 --only random --processor 0 --python {FRANKA_SIM}",
        "ended early: 0",
    ),
    "rehearse_franka --stops": (
        f"--stops --only stop-asked-for --tries 1 --processor 0 --python {FRANKA_SIM}",
        "| stopped |",
    ),
    "franka_peers": (
        f"--only dovetail --size 0.02 --processor 0 --python {FRANKA_SIM}",
        "| dovetail |",
    ),
    "resting_noise": ("--period 0.005 --plants mujoco", "mujoco"),
    "standing_still": ("--minutes 0.001 --twin none", "tool"),
    "robosuite_osc": ("FOLDER", ""),
    "robot_files": ("nowhere.urdf", "1 refused"),
    "tared_wrench": ("--starts 1 --twins none", "| none | yes |"),
    "tare_accuracy": ("--tries 1 --twins easy", "| easy |"),
    "torque_hashes": ("record FILE random", "4 hashes in FILE"),
    "tracking": ("--twins easy --periods 0.005", "easy"),
    "wrench_accuracy": ("--arms mujoco --periods 0.005", "| mujoco 5 ms |"),
    "training_time": (
        "--seeds 0 --steps 240 --learning-starts 200 --episodes 1 --tries 0 --peers",
        "| dovetail | 0 |",
    ),
    "transfer_threshold": ("--out out --grades 1 --tries 1", "every try inserted"),
}
"""Words of the command line, and what it prints."""


def is_installed(what):
    """Whether a module is there, and has what is named after a colon."""
    if what == "franka_sim":  # it wants an older NumPy than the tests
        return FRANKA_SIM.exists()
    module, _, name = what.partition(":")
    if importlib.util.find_spec(module.partition(".")[0]) is None:
        return False
    return not name or hasattr(importlib.import_module(module), name)


def names():
    return sorted(path.stem for path in BENCHMARKS.glob("*.py"))


def test_every_benchmark_has_a_tiny_size_here():
    assert set(names()) == MODULES | {name.partition(" ")[0] for name in TINY}


@pytest.mark.parametrize("name", TINY)
def test_a_benchmark_runs(name, tmp_path):
    for what, way in NEEDS.get(name, {}).items():
        if not is_installed(what):
            pytest.skip(f"{name} needs {what.partition(':')[0]}: {way}")
        if what == "franka_sim":
            need_franka_sim_alone()
    words, prints = TINY[name]
    script = BENCHMARKS / f"{name.partition(' ')[0]}.py"
    done = subprocess.run(
        [sys.executable, str(script), *words.split()],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ,
    )
    assert done.returncode == 0, done.stderr
    assert prints in done.stdout
