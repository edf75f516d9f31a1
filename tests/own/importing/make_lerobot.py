"""Make the samples lerobot_v21/ and lerobot_v30/ beside this file with LeRobot's own package; no test runs this.

In an environment of its own: pip install lerobot==0.3.3 (format v2.1) or lerobot==0.4.4 (v3.0), then
python make_lerobot.py FOLDER. The videos are AV1, as LeRobot encodes by default.
"""

import inspect
import sys

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset  # pyright: ignore[reportMissingImports]

EPISODES, FRAMES, FPS, SIDE_PX = 3, 16, 10, 64
NAMES = ["x", "y", "z", "gripper"]
TOP = "observation.images.top"

if __name__ == "__main__":
    state = {"dtype": "float32", "shape": (4,), "names": NAMES}
    picture = {"dtype": "video", "shape": (SIDE_PX, SIDE_PX, 3), "names": ["height", "width", "channels"]}
    features = {"observation.state": state, "action": state, TOP: picture}
    dataset = LeRobotDataset.create("me/table", FPS, features, root=sys.argv[1], use_videos=True)
    task_apart = "task" in inspect.signature(dataset.add_frame).parameters
    for episode in range(EPISODES):
        for i in range(FRAMES):
            u = i / (FRAMES - 1)
            values = np.array([0.1 + 0.8 * u, 0.1 + 0.8 * u**2, 0.05 * episode, 3 < i < 12], np.float32)
            pixels = np.full((SIDE_PX, SIDE_PX, 3), 40 + 80 * episode, np.uint8)  # each episode has its grey
            pixels[:, : 4 * i] = [200, 40, 40]  # a red bar that grows with time
            frame = {"observation.state": values, "action": values + 1, TOP: pixels}
            if task_apart:
                dataset.add_frame(frame, task="carry the cup")
            else:
                dataset.add_frame(frame | {"task": "carry the cup"})
        dataset.save_episode()
    if hasattr(dataset, "finalize"):
        dataset.finalize()
