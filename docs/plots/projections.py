"""The paper's numerical example: one projection, the other, and both."""

import matplotlib.pyplot as plt
import numpy as np

from noslip.experiments.numerical_example import NumericalExample
from noslip.figures import style

example = NumericalExample.run()
motions = example.motions
lines = {
    "demonstration": {"color": "0.7", "lw": 4},
    "constrained": {"color": style.PALETTE["vermillion"], "ls": "--"},
    "optimized": {"color": "k", "lw": 1.2},
}
labels = {
    "demonstration": "demonstration (slips)",
    "constrained": "pointwise projection alone",
    "optimized": "projected as a whole, then pointwise",
}
figure, (path, yaw) = plt.subplots(1, 2, figsize=(8.5, 3.4), layout="constrained")
for name, line in lines.items():
    motion = motions[name]
    path.plot(*motion.positions[:, :2].T, **line, label=labels[name])
    angle = np.unwrap(motion.rotations.as_euler("xyz")[:, 2])
    yaw.plot(motion.times, np.degrees(angle), **line)
path.set_aspect("equal", adjustable="datalim")
figure.legend(loc="outside lower center", ncols=3, fontsize=8)
style.dress(path, "x (m)", "y (m)", title="alone, the pointwise projection leaves the path")
style.dress(yaw, "time (s)", "yaw (°)", title="projected as a whole, the tool turns further")
