"""Pictures of the model for the README: `make pictures` (needs EGL or OSMesa; set MUJOCO_GL)."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import mujoco
import numpy as np

from models.attitude.quaternion import from_rotation_vector
from models.plants.nacs import compile_nacs

HERE = Path(__file__).parent
TILT = np.radians([5.0, -4.0, 12.0])
SHOTS = {"testbed": "overview", "wheels": "wheels", "testbed_below": "below"}
WIDTH, HEIGHT = 1800, 1200


def main() -> None:
    """Render each camera at a lively attitude."""
    model = compile_nacs().scene
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    x, y, z, w = from_rotation_vector(TILT)
    data.qpos[:4] = w, x, y, z
    data.qpos[4:8] = 0.4, 1.1, 0.2, 0.8
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for name, camera in SHOTS.items():
            renderer.update_scene(data, camera)
            matplotlib.image.imsave(HERE / f"{name}.png", renderer.render())


if __name__ == "__main__":
    main()
