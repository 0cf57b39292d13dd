"""Load a folder with the package lerobot-dataset, and say what it found, as JSON.

It runs in a process of its own, with the folder of the package on its path: that asks
for an older OpenCV than the camera here does.
"""

import json
import sys
from pathlib import Path

import torch


def main(root):
    try:
        import torchvision  # noqa: F401
    except RuntimeError:
        # One for CUDA beside a torch without lacks its operators; no picture is here.
        for name in ("nms", "qnms"):
            torch.library.define(
                f"torchvision::{name}",
                "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
            )
    from ledataset.datasets.lerobot_dataset import LeRobotDataset
    from ledataset.datasets.utils import DEFAULT_FEATURES, validate_frame

    period = 1.0 / 20
    ages = {"observation.state": [-period, 0.0], "action": [0.0, period]}
    data = LeRobotDataset("local/shown", root=root, delta_timestamps=ages)
    plain = LeRobotDataset("local/shown", root=root, episodes=[1])
    for item in plain:
        frame = {
            name: item[name].numpy().reshape(feature["shape"])
            for name, feature in plain.features.items()
            if name not in DEFAULT_FEATURES
        }
        validate_frame({**frame, "task": item["task"]}, plain.features)
    loader = torch.utils.data.DataLoader(data, batch_size=len(data))
    (batch,) = list(loader)
    found = {
        "episodes": data.num_episodes,
        "frames": data.num_frames,
        "fps": data.fps,
        "robot": data.meta.robot_type,
        "task": plain[0]["task"],
        "version": str(data.meta._version),
        "second": plain.num_frames,
        "shape": list(batch["observation.state"].shape),
        "states": batch["observation.state"][:, 1].tolist(),
        "actions": batch["action"][:, 0].tolist(),
        "mean": data.meta.stats["action"]["mean"].tolist(),
        "led": batch["is_intervention"].flatten().tolist(),
    }
    sys.stdout.write(json.dumps(found))


main(Path(sys.argv[1]))
