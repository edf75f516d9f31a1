"""Print digests of what the models compute on one scene, for `test_processors.py` to compare between processors."""

import hashlib

from pipeline.runtime.instructions import fix_instructions

fix_instructions()

import numpy as np  # noqa: E402
import torch  # noqa: E402
from torch.optim import AdamW  # noqa: E402

from pipeline.models.base import to_tensor  # noqa: E402
from pipeline.models.clearance.clearance import ClearanceModel  # noqa: E402
from pipeline.models.irl.reward_map import RewardMap  # noqa: E402


def main() -> None:
    """Perceive a scene before and after a training step of each model; judge paths by their clearance."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    table = rng.normal(150, 4, (100, 100, 3))
    table[20:40, 30:50], table[60:90, 70:75] = (220, 215, 210), (90, 95, 100)
    image = to_tensor(np.clip(table, 0, 255).astype(np.uint8)[None])
    z_theta = torch.from_numpy(rng.uniform(0, 1, (1, 40, 2)).astype(np.float32))
    clearance, reward_map = ClearanceModel(8), RewardMap(16, 2, 1.0, 0.0, 10)
    reward_map.scale.fill_(1)
    for model in (clearance, reward_map):
        optimiser = AdamW(model.parameters(), lr=0.01, fused=True)
        for step in range(2):
            percept = model.perceive(image)
            judged = model.logit(percept, z_theta) if model is clearance else percept  # QEMU 7.2 samples maps wrongly
            md5s = [hashlib.md5(x.detach().numpy().tobytes()).hexdigest() for x in (percept, judged)]
            print(type(model).__name__, int((percept != 0).sum()), *md5s)
            if step == 0:
                judged.square().mean().backward()
                optimiser.step()


if __name__ == "__main__":
    main()
