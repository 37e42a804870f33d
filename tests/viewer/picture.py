"""Draws docs/images/viewer.png: a cut around a nerve and a vessel, as the page shows it.

python tests/viewer/picture.py --out docs/images/viewer.png
python tests/viewer/picture.py --arm --out docs/images/viewer_arm.png
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright
from scipy.spatial.transform import Rotation
from test_viewer_browser import ARGUMENTS, CHROMIUM, Tab, fill

import noslip as ns
from noslip.cli.simulate import run as simulate
from noslip.viewer import Page, read_simulation

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--out", default="viewer.png", help="the picture's file")
parser.add_argument("--arm", action="store_true", help="draw an arm that executes it")
given = parser.parse_args()

# A straight cut of 10 cm in 4 s, demonstrated before either was known of; the hand wavers.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0.002 * np.sin(6 * np.pi * u), 0 * u])
hand = ns.PoseTrajectory(4 * s, path, Rotation.identity(len(s)), name="demonstration.csv")
rules = [
    ns.KeepOutSphere(center=(0.03, -0.004, 0.0), radius=0.012),
    ns.constraints.KeepOutCapsule(start=(0.07, 0.006, 0.0), end=(0.09, 0.03, 0.0), radius=0.01),
    ns.Blade(),
    ns.constraints.PlaneContact(),
]
dmp = ns.learn(hand, rules)

shown: dict = {"excision.json": dmp, "demonstration.csv": hand}
if given.arm:
    with tempfile.TemporaryDirectory() as folder:
        # Once around the nerve alone: no arm turns as fast as that waver asks for.
        path = np.column_stack([0.1 * u, 0.02 * np.sin(np.pi * u), 0 * u])
        bent = ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", 0.4 * np.cos(np.pi * s)))
        nerve = ns.KeepOutSphere(center=(0.05, 0.0, 0.0), radius=0.012)
        primitive = ns.learn(bent, [nerve, *rules[2:]]).save(f"{folder}/excision.json")
        arm = Path(folder) / "arm"
        simulate(
            primitive,
            out=arm,
            placement="0.5,0,0.2,0.5",
            dynamics="impedance",
            noise=True,
            model_error=0.05,
        )
        shown = {"arm": read_simulation(arm)}
page = Page(shown, port=0)
with sync_playwright() as p:
    browser = p.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
    tab = Tab(browser, width=1280, height=800, sharpness=1.0)
    tab.open(f"{page.address}/")
    fill(tab, "Time (s)", "1.7")
    tab.view.get_by_text("1.700 s" if given.arm else "1.696 s").wait_for()
    # What is drawn in software comes later than the text.
    tab.view.wait_for_timeout(3000)
    tab.view.screenshot(path=given.out)
    browser.close()
page.stop()
