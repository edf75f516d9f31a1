"""A keep-out mask, read by the conventions of Nav2's map server, lies on the table as the model sees it."""

from pathlib import Path

import cv2
import numpy as np
import torch
import yaml

from pipeline.models.base import ValidityModel
from pipeline.own.export import FIELDS, keep_out, write_mask

SIZE_M = (1.2, 0.8)


class NearRight(ValidityModel):
    """Rejects standing beyond .9 m in x and under .2 m in y, whatever the picture."""

    def perceive(self, images: torch.Tensor) -> torch.Tensor:
        return torch.zeros(len(images))

    def logit(self, percept: torch.Tensor, z_theta: torch.Tensor) -> torch.Tensor:
        x, y = (z_theta.mean(-2) * max(SIZE_M)).unbind(-1)
        return torch.where((x > 0.9) & (y < 0.2), -9.0, 9.0)


def test_a_mask_is_read_by_the_map_server_where_the_model_rejects_standing(tmp_path: Path):
    mask = keep_out(NearRight(), np.zeros((1, 100, 100, 3), np.uint8), SIZE_M)
    write_mask(tmp_path / "mask", mask, max(SIZE_M), "Ana, a")
    told = yaml.safe_load((tmp_path / "mask.yaml").read_text())
    grey = cv2.imread(str(tmp_path / told["image"]), cv2.IMREAD_UNCHANGED)
    assert grey is not None and grey.shape == (round(FIELDS * 0.8 / 1.2), FIELDS) and told["mode"] == "trinary"
    occupancy = np.abs(255 * (1 - told["negate"]) - grey.astype(float)) / 255
    places = np.random.default_rng(0).uniform(0, SIZE_M, (500, 2))
    places = places[(np.abs(places - [0.9, 0.2]) > told["resolution"]).all(1) & (places[:, 1] < 0.78)]
    column, up = np.floor((places - told["origin"][:2]) / told["resolution"]).astype(int).T  # of the lower left pixel
    read = occupancy[len(grey) - 1 - up, column]
    rejected = (places[:, 0] > 0.9) & (places[:, 1] < 0.2)
    assert (read[rejected] > told["occupied_thresh"]).all() and (read[~rejected] < told["free_thresh"]).all()
    assert rejected.any() and told["origin"] == [0, 0, 0]
